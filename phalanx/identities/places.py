"""Which agents' places are free, and who was given one."""

import threading
import time
from collections.abc import Callable, Collection, Mapping

from phalanx.wire.messages import Place, PlaceRequest

_KEPT = 20.0
"""How long a place is kept for who was given it and has not joined yet [s]."""


class Places:
    """Gives free places to claimants, each to one at a time; any thread may ask.

    A claimant that asks again gets what it was given. One that did not join in time loses its
    place to the next, but not what proves its name: it may still speak for that agent, no other.
    """

    def __init__(
        self,
        programs: Mapping[str, Collection[str]],
        vacant: Callable[[], Collection[str]],
        digest: str,
        sign: Callable[[str, bytes], bytes],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin with nothing given.

        Args:
            programs: by name, the agents that each decides for.
            vacant: the agents that the run waits for and nobody is.
            digest: of the scenario; who runs another gets no place.
            sign: makes the certificate of a name for a public key; raises ValueError.
            now: the wall clock [s].
        """
        self._programs, self._vacant, self._digest = programs, vacant, digest
        self._sign, self._now = sign, now
        self._given: dict[str, tuple[bytes, float]] = {}
        """By name: to whose key, and when [s]."""
        self._lock = threading.Lock()

    def answer(self, request: PlaceRequest) -> Place:
        """The place that a claimant gets, or why it gets none."""
        if request.digest != self._digest:
            return Place(refusal="start it with the plant's --scenario, --seed and --set")
        with self._lock:
            name = self._free(request.public_key)
            if not name:
                return Place()
            try:
                certificate = self._sign(name, request.public_key)
            except ValueError as error:
                return Place(refusal=str(error))
            self._given[name] = request.public_key, self._now()
        return Place(name=name, certificate=certificate)

    def _free(self, public_key: bytes) -> str:
        vacant, now = set(self._vacant()), self._now()
        free = [name for name, own in self._programs.items() if vacant.issuperset(own)]
        kept = {n: key for n, (key, since) in self._given.items() if now < since + _KEPT}
        own = (name for name in free if kept.get(name) == public_key)
        return next(own, next((name for name in free if name not in kept), ""))
