"""Ctrl-C at any moment of the start: one word, the right status, and nobody left behind."""

import os
import signal
from collections.abc import Callable

import pytest

from tests.process.runs import wait_for
from tests.process.swarm.processes import Run

pytestmark = pytest.mark.swarm

MOMENTS: dict[str, Callable[[Run], object]] = {
    "when Python has hardly begun": lambda run: run.descendants(),
    "when the folder is there": lambda run: list(run.parent.glob("*-1")),
    "when the first program is there": lambda run: run.programs(),
    "when half of the programs are there": lambda run: len(run.programs()) >= 3,
    "when all programs are there": lambda run: len(run.programs()) == 6,
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_ctrl_c_while_a_run_starts_ends_it_without_a_traceback(phalanx, moment: str) -> None:
    run = phalanx("run", "unicycles", "--set", "duration=500")
    wait_for(lambda: MOMENTS[moment](run) or run.process.poll() is not None)
    # The terminal sends it to every process of the group.
    os.killpg(run.process.pid, signal.SIGINT)
    status, printed = run.finish()
    assert "Traceback" not in printed
    # Before Python is up to it, the signal ends the process by itself.
    assert status in (130, -signal.SIGINT), printed
    run.wait_until_gone(10)
