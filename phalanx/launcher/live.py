"""The address of a running run: a small file in its folder, removed at the end."""

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
    """The address of a run and a viewer's keys."""

    run: str
    endpoint: str
    held: dict[str, bytes]
    """As phalanx.wire.membership.Membership."""

    @property
    def membership(self) -> Membership:
        """The membership of a viewer."""
        return Membership(self.run, self.endpoint, held=self.held)


@contextlib.contextmanager
def announced(folder: Path, membership: Membership) -> Iterator[None]:
    """Write the address of the run into its folder for the time of the block. Raises EngineError.

    The file is locked as long as this process lives: a file left by a killed launcher is not.
    """
    file = folder / LIVE
    viewer = membership.of(VIEWER)
    found = LiveRun(viewer.run, viewer.endpoint, dict(viewer.held or {}))
    try:
        out = os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
        with contextlib.suppress(OSError):  # not every file system has locks
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
    """Return the address of the run of this folder; None if it or its launcher has ended."""
    with contextlib.suppress(OSError, msgspec.DecodeError), (folder / LIVE).open("rb") as file:
        found = msgspec.json.decode(file.read(), type=LiveRun)
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:  # its launcher holds the lock, or the file system has none
            return found
    return None
