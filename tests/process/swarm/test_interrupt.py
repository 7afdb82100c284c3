"""Ctrl-C at any moment of the start: one word, the right status, and no process left behind."""

import contextlib
import os
import signal
from collections.abc import Callable

import psutil
import pytest

from tests.process.runs import wait_for
from tests.process.swarm.processes import LONG, Run

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


SIGNALS = {
    "sigterm to the launcher": (os.kill, signal.SIGTERM),  # as a container's runtime does
    "sigterm to all": (os.killpg, signal.SIGTERM),  # as a service manager does
    "ctrl-c": (os.killpg, signal.SIGINT),  # as a terminal does
}


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize(("send", "number"), SIGNALS.values(), ids=SIGNALS)
def test_a_run_that_is_stopped_while_it_starts_ends_without_a_traceback(
    phalanx, send, number: signal.Signals, moment: str
) -> None:
    run = phalanx("run", "unicycles", *LONG)
    wait_for(lambda: MOMENTS[moment](run) or run.process.poll() is not None)
    send(run.process.pid, number)
    status, printed = run.finish()
    # Python's own is of a Ctrl-C that it drops at the lock of an import.
    assert "Traceback" not in printed or "_get_module_lock" in printed, printed
    # Ended by the signal itself, a shell says 130 too.
    assert status in (130, -number, -signal.SIGINT), printed
    assert not list(run.parent.glob("*/live.json"))
    run.wait_until_gone()


@pytest.mark.parametrize("engine", ["processes", "in-process"])
def test_a_ctrl_c_that_python_drops_ends_the_run_all_the_same(
    phalanx, tmp_path, monkeypatch, engine: str
) -> None:
    """Press Ctrl-C while the lock of an import is released."""
    (tmp_path / "sitecustomize.py").write_text(DROPPED)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    run = phalanx("run", "unicycles", *LONG, "--engine", engine)
    assert "Exception ignored" in run.ends(130)


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
