"""Where a run that goes on can be met: a small file in its folder, there as long as it runs."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from phalanx.wire.membership import Membership

LIVE = "live.json"


class LiveRun(msgspec.Struct):
    """How to listen to a run; its secret is not told."""

    run: str
    endpoint: str


@contextlib.contextmanager
def announced(folder: Path, membership: Membership) -> Iterator[None]:
    """Say in the run's folder where it can be met, while the block runs."""
    file = folder / LIVE
    file.write_bytes(msgspec.json.encode(LiveRun(membership.run, membership.endpoint)))
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            file.unlink()


def find_live(folder: Path) -> LiveRun | None:
    """How to listen to the run of this folder; None if it is over or never began."""
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode((folder / LIVE).read_bytes(), type=LiveRun)
    return None
