"""Viewers come and go; the run does not notice."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from phalanx.scenario.load import load
from tests.process.runs import HELD, SECRET, live_run
from tests.process.viewer.pages import viewer

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


def test_viewers_attached_killed_attached_again_and_stopped_leave_the_trajectory_as_it_is(
    tmp_path: Path,
) -> None:
    scenario = load("unicycles", ["duration=6.0"])
    with live_run(scenario, tmp_path / "alone") as alone:
        unseen = alone.summary()
    with live_run(scenario, tmp_path / "seen", HELD) as run:
        address = ("--connect", run.endpoint, "--run", "seen")
        with viewer(*address) as first:
            assert first.answers()
            first.process.kill()
        with viewer(*address) as second:
            assert second.answers()
            second.process.send_signal(signal.SIGSTOP)
            run.set_speed(1.0)
            summary = run.summary()
            assert (summary.trajectory, summary.outcome) == (unseen.trajectory, unseen.outcome), (
                summary.reason
            )
            second.process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize(
    ("run_id", "secret", "complaint"),
    [
        ("imagined", SECRET, "knows no run 'imagined'"),
        ("real", b"guessed", "is the secret the run's?"),
    ],
)
def test_a_viewer_that_finds_no_run_says_why(
    tmp_path: Path, run_id: str, secret: bytes, complaint: str
) -> None:
    with live_run(load("unicycles", ["duration=4.0"]), tmp_path / "real", HELD) as run:
        command = [sys.executable, "-m", "phalanx", "viewer", "--connect", run.endpoint]
        process = subprocess.run(
            [*command, "--run", run_id, "--timeout", "2"],
            env={**os.environ, "PHALANX_SECRET": secret.decode()},
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        run.set_speed(0.0)
    assert process.returncode == 3
    assert complaint in process.stderr
