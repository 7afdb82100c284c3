"""The address of a live run in its folder, readable by the run's user alone."""

import ctypes
import os
import stat
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from phalanx.launcher.engine import EngineError
from phalanx.launcher.live import LIVE, announced, find_live
from phalanx.wire.membership import Membership

OURS = Membership("r", "tcp/127.0.0.1:7447", b"secret")
IN_ATTRIB, IN_CREATE = 0x4, 0x100
EVENT = struct.Struct("iIII")


@pytest.fixture
def no_umask() -> Iterator[None]:
    """Files get the mode that they are made with."""
    before = os.umask(0)
    yield
    os.umask(before)


def test_nobody_else_can_read_it_from_its_creation_on(tmp_path: Path, no_umask: None) -> None:
    """Its mode is right, and was never another: nothing has changed it."""
    libc = ctypes.CDLL(None)
    watching = libc.inotify_init1(os.O_NONBLOCK)
    libc.inotify_add_watch(watching, bytes(tmp_path), IN_ATTRIB | IN_CREATE)
    with announced(tmp_path, OURS):
        mode = stat.S_IMODE((tmp_path / LIVE).stat().st_mode)
        happened = os.read(watching, 4096)
    os.close(watching)
    _, what, _, length = EVENT.unpack_from(happened)
    assert mode == 0o600
    assert (what, EVENT.size + length) == (IN_CREATE, len(happened)), "created, and no more"


def test_it_is_not_written_into_a_file_that_somebody_else_put_there(tmp_path: Path) -> None:
    (tmp_path / LIVE).touch(0o666)
    with pytest.raises(EngineError, match=LIVE), announced(tmp_path, OURS):
        pass
    assert not (tmp_path / LIVE).read_bytes()


def test_it_has_a_viewers_keys_and_goes_with_the_run(tmp_path: Path) -> None:
    with announced(tmp_path, OURS):
        found = find_live(tmp_path)
        assert found is not None
        assert found.credentials == OURS.credentials
        assert not found.secret
    assert find_live(tmp_path) is None
