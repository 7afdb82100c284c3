"""How runs end: Ctrl-C, a death, a full disk. No orphan, a readable recording, a last line."""

import os
import resource
import signal

import pytest

from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import read
from tests.process.runs import wait_for

pytestmark = pytest.mark.swarm

ORPHAN_LIMIT = 5.0
"""Nothing of a run may live longer after its end [s]."""


def test_ctrl_c_ends_the_run_cleanly(phalanx):
    run = phalanx("run", "unicycles")
    run.wait_until_running()
    os.killpg(run.process.pid, signal.SIGINT)  # as a terminal does: to the whole group
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 130
    assert output.splitlines()[-1].startswith("stopped: stopped by the user")
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.STOPPED
    assert recording.summary.trajectory
    assert recording.steps


def test_a_killed_agent_breaks_the_run_and_is_named(phalanx):
    run = phalanx("run", "unicycles")
    run.wait_until_running()
    run.programs()["phx-agent-2"].kill()
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 3
    assert "broken: agent 2 died" in output
    assert "[phx-agent-2 died (killed by SIGKILL)" in output
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.BROKEN


def test_a_killed_plant_stops_the_agents_and_leaves_what_it_recorded(phalanx):
    run = phalanx("run", "unicycles")
    run.wait_until_running()
    agents = [process for name, process in run.programs().items() if name != "phx-plant"]
    run.programs()["phx-plant"].kill()
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 3
    assert "phx-plant died (killed by SIGKILL)" in output
    assert not any(process.is_running() for process in agents)
    recording = read(run.folder)
    assert "cut short after t = " in recording.damage
    assert recording.steps


def test_agents_leave_by_themselves_when_the_hub_is_closed(phalanx, tmp_path):
    """Nothing is shared but Zenoh: there is no launcher here that could stop them."""
    from phalanx.wire.session import free_endpoint

    endpoint = free_endpoint()
    common = ("--scenario", "unicycles", "--run", "r")
    plant = phalanx("plant", *common, "--listen", endpoint, "--out", str(tmp_path))
    agents = [phalanx("agent", name, *common, "--connect", endpoint) for name in "12345"]
    recording = tmp_path / "recording.mcap"
    wait_for(lambda: recording.exists() and recording.stat().st_size > 100_000)
    plant.process.kill()
    for agent in agents:
        status, output = agent.finish(timeout=ORPHAN_LIMIT)
        assert status == 0, output


def test_a_killed_launcher_leaves_no_orphan(phalanx):
    run = phalanx("run", "unicycles")
    run.wait_until_running()
    run.process.kill()
    run.wait_until_gone(ORPHAN_LIMIT)
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.BROKEN
    assert recording.summary.reason == "the launcher died"


def test_a_full_disk_breaks_the_run_and_names_the_file(phalanx):
    """A limit on file size is the full disk that needs no root."""
    run = phalanx("run", "unicycles", limit=limit_files_to_150_kb)
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 3
    assert "recording.mcap" in output.splitlines()[-1]
    recording = read(run.folder)
    assert "cut short" in recording.damage
    assert recording.steps


def test_an_agent_that_cannot_start_is_named_with_its_error(phalanx, tmp_path, monkeypatch):
    module = tmp_path / "faulty_law.py"
    module.write_text(FAULTY_LAW)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    law = '{ type = "faulty_law:Faulty" }'
    run = phalanx("run", "unicycles", "--set", f"agents.1.law={law}")
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 3
    assert "agent 4 died" in output or "agent 5 died" in output
    assert "RuntimeError: no such sensor" in output


def limit_files_to_150_kb() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))


FAULTY_LAW = """
from dataclasses import dataclass

@dataclass
class Faulty:
    def prepare(self, dynamics):
        pass

    def input(self, view):
        raise RuntimeError("no such sensor")
"""


FAILING = """
from phalanx.theory.laws.velocity import TrackVelocity as Base


class TrackVelocity(Base):
    def join(self, i, members, obstacles):
        if members[i].name == "2":
            raise RuntimeError("no camera")
        return self
"""


def test_an_agent_that_fails_before_it_joins_ends_the_run_at_once_and_is_named(
    phalanx, tmp_path, monkeypatch
):
    (tmp_path / "failing_user.py").write_text(FAILING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    law = "agents.0.law={ type = 'failing_user:TrackVelocity', gain = 1.0 }"
    run = phalanx("run", "unicycles", "--set", law, "--set", "time.timeout=600")
    status, output = run.finish()
    run.wait_until_gone(ORPHAN_LIMIT)
    assert status == 3
    assert "broken: an agent failed [phx-agent-2 died (exit status 1)" in output
    assert "no camera" in output
