"""Who has joined a run, and who has left it; which places are free, and who was given one."""

import threading
import time
from collections.abc import Callable, Collection, Mapping

from phalanx.swarm.swarm import Swarm
from phalanx.wire.keys import kind_and_name
from phalanx.wire.messages import Place, PlaceRequest

_KEPT = 20.0
"""How long a place is kept for who was given it and has not joined yet [s]."""


class Joining:
    """The agents of one run, as their liveliness tokens come and go."""

    def __init__(
        self, swarm: Swarm, may_leave: bool, now: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin without members.

        Args:
            swarm: of the scenario.
            may_leave: whether agents that joined may go, and come back.
            now: the wall clock [s].
        """
        self.digest = swarm.digest
        """Of the scenario; an agent that runs another one cannot take part."""
        self._names, self._may_leave = swarm.names, may_leave
        self._now = now
        self._joined: set[str] = set()
        self._dismissed: set[str] = set()
        self._here: set[str] = set()
        """Whose token is there."""
        self._awaited = set(swarm.names)
        """Whom the run has, or waits for."""
        self._begun = False
        self._gone: dict[str, float] = {}
        """By the wall clock, since when an agent that had joined is away [s]."""
        self._changes: list[tuple[int, bool]] = []

    def begin(self) -> None:
        """All are there: from now on nobody may go. Before, one may lose the hub and come back."""
        self._begun = True
        if not self._may_leave:
            self._awaited.clear()

    def gone_for(self, seconds: float) -> list[str]:
        """Who joined, and was lost so long ago."""
        now = self._now()
        return [name for name, since in self._gone.items() if now > since + seconds]

    def missing(self) -> tuple[str, ...]:
        """Agents that have not joined yet."""
        return tuple(name for name in self._names if name not in self._joined)

    def has(self, name: str) -> bool:
        """Whether an agent is there."""
        return name in self._joined

    def dismiss(self, name: str) -> None:
        """An agent that was told to die is not missed, and another process may take its place."""
        self._dismissed.add(name)
        self._awaited.discard(name)

    def invite(self, name: str) -> None:
        """Another process is asked for in a dead agent's place."""
        self._awaited.add(name)

    def vacant(self) -> tuple[str, ...]:
        """Whom the run waits for; any thread may ask."""
        return tuple(n for n in self._names if n in self._awaited and n not in self._here)

    def take_changes(self) -> list[tuple[int, bool]]:
        """Who went, and who came back, since this was last called: (i, is back)."""
        taken, self._changes = self._changes, []
        return taken

    def on_token(self, key: str, alive: bool) -> str | None:
        """A token appeared or disappeared; what that breaks, in words, or None."""
        (_, name), found = kind_and_name(key), key.rsplit("/", 1)[-1]
        if name not in self._names:
            return None
        if found == self.digest:
            (self._here.add if alive else self._here.discard)(name)
        if name in self._joined and self._may_leave:
            self._changes += [(self._names.index(name), alive)] if found == self.digest else []
            return None
        if name in self._joined:
            if alive or found != self.digest:
                return None
            self._joined.remove(name)
            if name in self._dismissed:
                return None
            if self._begun:
                return f"agent {name} died: see its log"
            self._gone[name] = self._now()
            return None
        if alive and found != self.digest:
            return (
                f"agent {name} runs another scenario, seed or version (digest {found}, here "
                f"{self.digest}): start it with the plant's --scenario, --seed and --set"
            )
        if alive:
            self._joined.add(name)
            self._dismissed.discard(name)
            self._gone.pop(name, None)
        return None


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
