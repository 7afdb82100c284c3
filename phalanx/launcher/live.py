"""The address of a running run: a small file in its folder, removed at the end."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from phalanx.launcher.engine import EngineError
from phalanx.messages.keys import VIEWER
from phalanx.messages.membership import Membership

LIVE = "live.json"


@contextlib.contextmanager
def announced(folder: Path, membership: Membership) -> Iterator[None]:
    """Write a viewer's membership into the run's folder for the time of the block.

    Raises EngineError.

    The file is locked as long as this process lives: a file left by a killed launcher is not.
    """
    file = folder / LIVE
    try:
        out = os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
        with contextlib.suppress(OSError):  # not every file system has locks
            fcntl.flock(out, fcntl.LOCK_EX)
        out.write(msgspec.json.encode(membership.of(VIEWER)))
    except OSError as error:
        raise EngineError(f"{error.strerror}: {file}") from error
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            file.unlink()
        out.close()


def find_live(folder: Path) -> Membership | None:
    """Return a viewer's membership of this folder's run; None if it or its launcher has ended.

    Raises EngineError: what has the file's name is none, such as a pipe.
    """
    file = folder / LIVE
    if file.exists() and not file.is_file():
        raise EngineError(f"{file}: expected a regular file: remove it, a run did not make it")
    with contextlib.suppress(OSError, msgspec.DecodeError), file.open("rb") as opened:
        membership = msgspec.json.decode(opened.read(), type=Membership)
        try:
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:  # its launcher holds the lock, or the file system has none
            return membership
    return None
