"""Claiming a place: a program that is nobody yet asks the plant which agent to be.

A claimant may ask, and nothing else. Where certificates say who is who it makes a key of its own,
and the plant signs that the key is the free agent's: nobody else ever has it.
"""

import contextlib
import logging
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from phalanx.hosts.authority import new_key, private_pem, public_der, write_certificate
from phalanx.wire import pubsub
from phalanx.wire.credentials import AUTHORITY
from phalanx.wire.keys import PLANT
from phalanx.wire.liveliness import PlantPresence
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Place, PlaceRequest
from phalanx.wire.seal import Malformed
from phalanx.wire.session import HubError, open_member

log = logging.getLogger("phalanx.agent")

_AGAIN = 0.3
"""After so long it is asked again whether a place is free [s]."""


class ClaimError(HubError):
    """The plant gives no place; the message says why."""


@contextlib.contextmanager
def claimed(membership: Membership, digest: str) -> Iterator[Membership | None]:
    """The membership that a claimant is given, while the block runs; None if the run ends before.

    It waits until a place is free.

    Args:
        membership: the claimant's.
        digest: of the scenario, which must be the plant's.

    Raises:
        HubError: the hub cannot be reached. ClaimError: the plant gives no place.
    """
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
