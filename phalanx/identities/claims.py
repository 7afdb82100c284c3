"""How a program that is nobody yet becomes one of the scenario's agents: it asks the plant.

A claimant may ask, and nothing else. Where certificates say who is who it makes a key of its own,
and the plant signs that the key is the free agent's: nobody else ever has it.
"""

import contextlib
import logging
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from phalanx.wire import pubsub
from phalanx.wire.keys import PLANT
from phalanx.wire.liveliness import PlantPresence
from phalanx.wire.membership import AUTHORITY, Membership
from phalanx.wire.messages import Place, PlaceRequest
from phalanx.wire.seal import Malformed
from phalanx.wire.session import open_member

log = logging.getLogger("phalanx.agent")

_AGAIN = 0.3
"""After so long it is asked again whether a place is free [s]."""
_KEPT = 20.0
"""How long a place is kept for who was given it and has not joined yet [s]."""


class ClaimError(RuntimeError):
    """The plant gives no place; the message says why."""


@contextlib.contextmanager
def claimed(membership: Membership, digest: str) -> Iterator[Membership | None]:
    """What a claimant becomes, for as long as the block runs; None if the run ends before.

    It waits until a place is free.

    Args:
        membership: the claimant's.
        digest: of the scenario, which must be the plant's.

    Raises:
        HubError: the hub cannot be reached. ClaimError.
    """
    # A local run, whose plant gives places too, does not load it.
    from phalanx.identities.authority import new_key, private_pem, public_der, write_certificate

    key = new_key()
    question = PlaceRequest(digest=digest, public_key=public_der(key))
    place = _ask(membership, question)
    if place is None:
        yield None
        return
    log.info("claimed the place of %s", place.name)
    if membership.certificates is None:
        yield replace(membership, identity=place.name)
        return
    with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
        authority = (membership.certificates / AUTHORITY).read_bytes()
        write_certificate(Path(folder), authority, place.certificate, private_pem(key))
        yield replace(membership, identity=place.name, certificates=Path(folder))


def _ask(membership: Membership, question: PlaceRequest) -> Place | None:
    keys, sealer, over = membership.keys, membership.sealer, threading.Event()
    asked = sealer.seal(keys.place, question)
    with open_member(
        membership.endpoint, keys.alive(PLANT), membership.timeout, membership.credentials
    ) as session:
        PlantPresence(membership.timeout, lambda _: over.set()).watch(session, keys)
        while not over.wait(_AGAIN):
            answer = pubsub.ask(session, keys.place, _AGAIN, asked)
            place = Place()
            with contextlib.suppress(Malformed):
                place = sealer.open(keys.place, answer, Place) if answer else place
            if place.refusal:
                raise ClaimError(f"no place in run {membership.run}: {place.refusal}")
            if place.name:
                return place
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


def signer(certificates: Path | None) -> Callable[[str, bytes], bytes]:
    """How a plant signs: with the authority's key in its folder; not at all where it has none.

    Raises OSError, ValueError: the key cannot be read.
    """
    if certificates is None:
        return lambda *_: b""
    from phalanx.identities.authority import Authority, read_public  # a local run loads none of it

    authority = Authority.read(certificates)

    def sign(name: str, public_key: bytes) -> bytes:
        if authority is None:
            raise ValueError("the plant's certificate was made without `phalanx keys --claims`")
        return authority.sign(name, read_public(public_key))

    return sign
