"""phalanx tap: the messages of a live run, decoded without their types."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from phalanx.faults.commands import CommandPolicy
from phalanx.scenario.load import load
from phalanx.wire.messages import VERSION
from tests.process.runs import COMMAND_SECRET, SECRET, live_run, wait_for

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


SLOW = CommandPolicy(secret=COMMAND_SECRET, speed=0.05)
"""A minute in which two readers come, and a hundred messages a second."""


def tap(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "phalanx", "tap", *arguments]
    environment = {**os.environ, "PHALANX_SECRET": SECRET.decode()}
    return subprocess.run(command, capture_output=True, text=True, timeout=170, env=environment)


def test_tap_prints_every_kind_of_message_of_a_run_that_goes_on(tmp_path: Path):
    scenario = load("unicycles", {"duration": 3.0})
    with live_run(scenario, tmp_path / "live", SLOW) as run:
        wait_for(lambda: run.status is not None and run.status.t > 0)
        done = tap(str(run.folder), "--count", "60")
        only = tap(
            run.folder.name,
            "--connect",
            run.endpoint,
            "--kind",
            "broadcast",
            "--count",
            "5",
        )
        run.set_speed(0.0)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 60
    assert all(key.startswith(f"phalanx/{run.folder.name}/") for key, _ in lines)
    assert all(fields[0] == VERSION for _, fields in lines)
    kinds = {key.split("/")[2] for key, _ in lines}
    assert kinds >= {"sample", "actuation", "broadcast", "telemetry"}
    heard = [json.loads(line) for line in only.stdout.splitlines()]
    assert len(heard) == 5
    assert {key.split("/")[2] for key, _ in heard} == {"broadcast"}
    assert {len(fields) for _, fields in heard} == {4}, "version, k, t_apply, u and nothing else"


def test_tap_says_where_no_run_goes_on(tmp_path: Path):
    done = tap(str(tmp_path))
    assert done.returncode == 64
    assert "no live run" in done.stderr
    assert "Traceback" not in done.stderr
