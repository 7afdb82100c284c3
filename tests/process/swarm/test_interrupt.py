"""Ctrl-C at any moment of the start: one word, the right status, and no process left behind."""

import contextlib
import os
import signal
from collections.abc import Callable

import psutil
import pytest

from tests.process.runs import wait_for
from tests.process.swarm.processes import Run

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]

MOMENTS: dict[str, Callable[[Run], object]] = {
    "when its libraries load": lambda run: loads(run, "pydantic_core"),
    "when more of them load": lambda run: loads(run, "_casadi"),
    "when the folder is there": lambda run: list(run.parent.glob("*-1")),
    "when the first program is there": lambda run: run.programs(),
    "when half of the programs are there": lambda run: len(run.programs()) >= 3,
    "when all programs are there": lambda run: len(run.programs()) == 6,
}


def loads(run: Run, library: str) -> bool:
    """Return whether the command has loaded this library."""
    with contextlib.suppress(psutil.Error):
        maps = psutil.Process(run.process.pid).memory_maps()
        return any(library in m.path for m in maps)
    return False


def assert_no_traceback(printed: str) -> None:
    """Require none but Python's own, of a Ctrl-C that it drops at the lock of an import."""
    assert "Traceback" not in printed or "_get_module_lock" in printed, printed


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("send", [os.kill, os.killpg], ids=["to the launcher", "to all"])
def test_sigterm_while_a_run_starts_ends_it_as_a_ctrl_c_does(phalanx, send, moment: str) -> None:
    """A container's runtime sends it to the launcher alone, a service manager to all."""
    run = phalanx("run", "unicycles", "--set", "duration=500")
    wait_for(lambda: MOMENTS[moment](run) or run.process.poll() is not None)
    send(run.process.pid, signal.SIGTERM)
    status, printed = run.finish()
    assert_no_traceback(printed)
    assert status in (130, -signal.SIGTERM, -signal.SIGINT), printed
    assert not list(run.parent.glob("*/live.json"))
    run.wait_until_gone()


@pytest.mark.parametrize("moment", MOMENTS)
def test_ctrl_c_while_a_run_starts_ends_it_without_a_traceback(phalanx, moment: str) -> None:
    run = phalanx("run", "unicycles", "--set", "duration=500")
    wait_for(lambda: MOMENTS[moment](run) or run.process.poll() is not None)
    # The terminal sends it to every process of the group.
    os.killpg(run.process.pid, signal.SIGINT)
    status, printed = run.finish()
    assert_no_traceback(printed)
    # Ended by the signal itself, a shell says 130 too.
    assert status in (130, -signal.SIGINT), printed
    run.wait_until_gone()


@pytest.mark.parametrize("engine", ["processes", "in-process"])
def test_a_ctrl_c_that_python_drops_ends_the_run_all_the_same(
    phalanx, tmp_path, monkeypatch, engine: str
) -> None:
    """Press Ctrl-C while the lock of an import is released."""
    (tmp_path / "sitecustomize.py").write_text(DROPPED)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    run = phalanx("run", "unicycles", "--set", "duration=500", "--engine", engine)
    status, printed = run.finish()
    assert "Exception ignored" in printed
    assert status == 130, printed
    run.wait_until_gone()


DROPPED = """
import os, signal, sys

class Importing:
    def find_spec(self, name, path=None, target=None):
        if name in ("phalanx.launcher.processes", "phalanx.launcher.simulation"):
            sys.meta_path.remove(self)
            LetGo()

class LetGo:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Importing())
"""
