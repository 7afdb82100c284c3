"""Request the place of a free agent: a program without a name asks the plant for one.

The claimant may only send this query. If programs have TLS identities it makes a key pair, and the
plant signs the public key with the agent's name: the private key never leaves this process.
"""

import contextlib
import logging
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from phalanx.hosts.authority import new_key, private_pem, public_der, write_identity
from phalanx.wire import pubsub
from phalanx.wire.credentials import AUTHORITY
from phalanx.wire.keys import PLANT
from phalanx.wire.liveliness import PlantPresence
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Place, PlaceRequest
from phalanx.wire.seal import Malformed
from phalanx.wire.session import HubError, open_member

log = logging.getLogger("phalanx.agent")

_PERIOD = 0.3
"""Time between two requests [s]."""


class PlaceRefusedError(HubError):
    """The plant gives no place; the message has the reason."""


@contextlib.contextmanager
def request_place(membership: Membership, digest: str) -> Iterator[Membership | None]:
    """Wait for a free place and yield its membership; None if the run ends before.

    A TLS identity that comes with it lies in a temporary folder for the time of the block. The
    scenario of this digest must be the plant's.

    Raises HubError if the hub cannot be reached, PlaceRefusedError if the plant gives no place.
    """
    key = new_key()
    place = _wait_for_place(membership, PlaceRequest(digest=digest, public_key=public_der(key)))
    if place is None:
        yield None
        return
    log.info("got the place of %s", place.name)
    if membership.identity_folder is None:
        yield replace(membership, identity=place.name)
        return
    with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
        authority = (membership.identity_folder / AUTHORITY).read_bytes()
        write_identity(Path(folder), authority, place.certificate, private_pem(key))
        yield replace(membership, identity=place.name, identity_folder=Path(folder))


def _wait_for_place(membership: Membership, request: PlaceRequest) -> Place | None:
    keys, sealer, over = membership.keys, membership.sealer, threading.Event()
    payload = sealer.seal(keys.place, request)
    with open_member(
        membership.endpoint, keys.alive(PLANT), membership.timeout, membership.credentials
    ) as session:
        PlantPresence(membership.timeout, lambda _: over.set()).watch(session, keys)
        while not over.wait(_PERIOD):
            answer = pubsub.ask(session, keys.place, _PERIOD, payload)
            place = Place()
            with contextlib.suppress(Malformed):
                place = sealer.open(keys.place, answer, Place) if answer else place
            if place.refusal:
                raise PlaceRefusedError(f"no place in run {membership.run}: {place.refusal}")
            if place.name:
                return place
    return None
