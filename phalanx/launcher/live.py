"""The address of a run that goes on: a small file in its folder, there as long as it runs."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from phalanx.launcher.engine import EngineError
from phalanx.wire.keys import VIEWER
from phalanx.wire.membership import Membership

LIVE = "live.json"


class LiveRun(msgspec.Struct):
    """The address of a run: all that a viewer may know, for those who may read the file."""

    run: str
    endpoint: str
    held: dict[str, bytes]
    """As phalanx.wire.membership.Membership."""

    @property
    def membership(self) -> Membership:
        """A viewer's."""
        return Membership(self.run, self.endpoint, held=self.held)


@contextlib.contextmanager
def announced(folder: Path, membership: Membership) -> Iterator[None]:
    """Say in the run's folder where it can be met, while the block runs. Raises EngineError.

    The file is locked as long as this process lives: one that a killed launcher left is not.
    """
    file = folder / LIVE
    viewer = membership.of(VIEWER)
    found = LiveRun(viewer.run, viewer.endpoint, dict(viewer.held or {}))
    try:
        out = os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
        with contextlib.suppress(OSError):  # not every file system knows locks
            fcntl.flock(out, fcntl.LOCK_EX)
        out.write(msgspec.json.encode(found))
    except OSError as error:
        raise EngineError(f"{error.strerror}: {file}") from error
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            file.unlink()
        out.close()


def find_live(folder: Path) -> LiveRun | None:
    """The address of the run of this folder; None if it or its launcher is gone."""
    with contextlib.suppress(OSError, msgspec.DecodeError), (folder / LIVE).open("rb") as file:
        found = msgspec.json.decode(file.read(), type=LiveRun)
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:  # its launcher holds the lock, or nobody can
            return found
    return None
