"""The address of a live run in its folder, readable by the run's user alone."""

import ctypes
import os
import stat
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from phalanx.cli.app import FAILED, status
from phalanx.launcher.engine import EngineError
from phalanx.launcher.live import LIVE, announced, find_live
from phalanx.messages.membership import Membership
from phalanx.recording.records import RECORDING, SUMMARY

OURS = Membership("r", "tcp/127.0.0.1:7447", b"secret")
IN_ATTRIB, IN_CREATE = 0x4, 0x100
EVENT = struct.Struct("iIII")


@pytest.fixture
def no_umask() -> Iterator[None]:
    """Files get the mode that they are made with."""
    before = os.umask(0)
    yield
    os.umask(before)


def test_no_other_user_can_read_it_from_its_creation_on(tmp_path: Path, no_umask: None) -> None:
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


def test_it_is_not_written_into_a_file_that_another_user_put_there(tmp_path: Path) -> None:
    (tmp_path / LIVE).touch(0o666)
    with pytest.raises(EngineError, match=LIVE), announced(tmp_path, OURS):
        pass
    assert not (tmp_path / LIVE).read_bytes()


@pytest.mark.timeout(20)
@pytest.mark.parametrize("command", ["view", "ros2", "runs"])
def test_a_pipe_in_its_place_is_refused_in_words(tmp_path: Path, capsys, command: str) -> None:
    folder = tmp_path / "r-1"
    folder.mkdir()
    (folder / RECORDING).touch()
    os.mkfifo(folder / LIVE)
    assert status([command, str(tmp_path if command == "runs" else folder)]) == FAILED
    printed = " ".join(capsys.readouterr().err.split())
    assert f"{folder / LIVE}: expected a regular file" in printed


@pytest.mark.timeout(20)
def test_pipes_in_the_places_of_other_files_are_not_read(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "r-1"
    folder.mkdir()
    (folder / RECORDING).touch()
    os.mkfifo(folder / SUMMARY)
    assert status(["runs", str(tmp_path)]) == 0
    assert "broken: no summary" in capsys.readouterr().out


def test_it_has_a_viewers_keys_and_goes_with_the_run(tmp_path: Path) -> None:
    with announced(tmp_path, OURS):
        live = find_live(tmp_path)
        assert live is not None
        assert live.credentials == OURS.credentials
        assert not live.secret
    assert find_live(tmp_path) is None
