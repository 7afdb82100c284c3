"""phalanx tap: the messages of a live run, decoded without their types."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from phalanx.faults.commands import CommandPolicy
from phalanx.messages.admission import access_control
from phalanx.messages.credentials import Admission
from phalanx.messages.keys import VIEWER
from phalanx.messages.kinds import VERSION, Broadcast
from phalanx.messages.membership import Membership
from phalanx.scenario.load import load
from phalanx.wire.session import HubError, free_endpoint, open_hub
from phalanx.wire.tap import tapped
from tests.process.runs import COMMAND_SECRET, SECRET, live_run, wait_for

pytestmark = pytest.mark.swarm


SLOW = CommandPolicy(secret=COMMAND_SECRET, speed=0.05)
"""A minute in which two readers come, and a hundred messages a second."""


def tap(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "phalanx", "tap", *arguments]
    environment = {**os.environ, "PHALANX_SECRET": SECRET.decode()}
    return subprocess.run(command, capture_output=True, text=True, timeout=170, env=environment)


@pytest.mark.nightly
def test_tap_prints_every_kind_of_message_of_a_run_that_goes_on(tmp_path: Path):
    scenario = load("unicycles", {"duration": 3.0})
    with live_run(scenario, tmp_path / "live", SLOW) as run:
        wait_for(lambda: run.status is not None and run.status.t > 0)
        process = tap(str(run.folder), "--count", "60")
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
    assert process.returncode == 0, process.stderr
    lines = [json.loads(line) for line in process.stdout.splitlines()]
    assert len(lines) == 60
    assert all(key.startswith(f"phalanx/{run.folder.name}/") for key, _ in lines)
    assert all(fields[0] == VERSION for _, fields in lines)
    kinds = {key.split("/")[2] for key, _ in lines}
    assert kinds >= {"sample", "actuation", "broadcast", "telemetry"}
    heard = [json.loads(line) for line in only.stdout.splitlines()]
    assert len(heard) == 5
    assert {key.split("/")[2] for key, _ in heard} == {"broadcast"}
    assert {len(fields) for _, fields in heard} == {len(Broadcast.__struct_fields__)}
    assert all(fields[4:] == [0.0, [], [], []] for _, fields in heard), "no state without a radio"


@pytest.mark.timeout(60)
def test_a_tap_of_a_run_that_the_hub_does_not_know_ends() -> None:
    there = Membership("somebody", free_endpoint(), timeout=0.5)
    hub = Admission({VIEWER: there.password_of(VIEWER)}, access_control(there.keys, {}, ()))
    with open_hub(there.endpoint, hub), pytest.raises(HubError, match=r"no run nobody at tcp/127"):
        next(tapped(replace(there, run="nobody")))
