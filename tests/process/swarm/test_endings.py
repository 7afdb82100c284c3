"""Ends of runs by Ctrl-C, a death or a full disk: no orphans, a readable recording, one line."""

import math
import os
import re
import resource
import signal
import subprocess
import sys
import time
from functools import partial

import psutil
import pytest

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.live import find_live
from phalanx.recording.read import read
from phalanx.wire.session import free_endpoint
from tests.layers import layered
from tests.process.runs import wait_for
from tests.process.swarm.processes import LONG, PATIENCE

pytestmark = pytest.mark.swarm


def test_ctrl_c_ends_the_run_cleanly(run):
    os.killpg(run.process.pid, signal.SIGINT)  # as a terminal does: to the whole group
    output = run.ends(130)
    assert output.splitlines()[-1].startswith("stopped: stopped by the user")
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.STOPPED
    assert recording.summary.trajectory
    assert recording.steps


ENDLESS = """
from dataclasses import dataclass
from pathlib import Path

@dataclass
class Endless:
    def prepare(self, dynamics):
        pass
    def input(self, view):
        Path("asked").touch()
        while True:
            pass
"""


@pytest.mark.parametrize("engine", ["in-process", "processes"])
def test_ctrl_c_ends_a_law_that_does_not_return(phalanx, tmp_path, monkeypatch, engine):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "endless.py").write_text(ENDLESS)
    law = ("--set", "agents.0.law={ type = 'endless:Endless' }")
    run = phalanx("run", "unicycles", "--engine", engine, *law)
    wait_for((tmp_path / "asked").exists)
    os.killpg(run.process.pid, signal.SIGINT)
    run.ends(130)


@pytest.mark.parametrize(
    ("send", "engine"),
    [
        pytest.param(os.kill, "processes", id="to the launcher of processes"),
        pytest.param(os.killpg, "in-process", id="to one process"),
        pytest.param(os.killpg, "processes", id="to all", marks=pytest.mark.nightly),
    ],
)
def test_sigterm_ends_the_run_as_ctrl_c_does(phalanx, send, engine):
    run = phalanx("run", "unicycles", "--engine", engine, *LONG)
    wait_for(lambda: recorded_bytes(run) > 100_000)
    send(run.process.pid, signal.SIGTERM)
    output = run.ends(130)
    assert output.splitlines()[-1].startswith("stopped: stopped by the user")
    assert read(run.folder).summary.outcome is Outcome.STOPPED
    assert {"summary.json", "recording.mcap"} <= {file.name for file in run.folder.iterdir()}
    assert not (run.folder / "live.json").exists()


def recorded_bytes(run) -> int:
    recording = run.folder / "recording.mcap"
    return recording.stat().st_size if recording.exists() else 0


def test_a_killed_launcher_leaves_no_orphan_and_no_live_run(run):
    assert find_live(run.folder)
    run.process.kill()
    assert (run.folder / "live.json").exists()
    wait_for(lambda: find_live(run.folder) is None, PATIENCE)
    run.wait_until_gone()
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.BROKEN
    assert recording.summary.reason == "the launcher died"


def test_a_killed_agent_breaks_the_run_and_is_named(run):
    run.programs()["phx-agent-2"].kill()
    output = run.ends(3)
    assert "broken: agent 2 died" in output
    assert "[phx-agent-2 died (killed by SIGKILL)" in output
    recording = read(run.folder)
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.BROKEN


def test_a_killed_plant_stops_the_agents_and_leaves_what_it_recorded(run):
    agents = [process for name, process in run.programs().items() if name != "phx-plant"]
    run.programs()["phx-plant"].kill()
    assert "phx-plant died (killed by SIGKILL)" in run.ends(3)
    assert not any(process.is_running() for process in agents)
    recording = read(run.folder)
    assert "cut short after t = " in recording.damage
    assert recording.steps


def test_agents_leave_by_themselves_when_the_hub_is_closed(phalanx, tmp_path):
    """Nothing is shared but Zenoh: there is no launcher here that could stop them."""
    endpoint = free_endpoint()
    common = ("--scenario", "one-on-one", "--run", "r", "--set", "time.timeout=600", *LONG)
    plant = phalanx("plant", *common, "--listen", endpoint, "--folder", str(tmp_path))
    agents = [phalanx("agent", name, *common, "--connect", endpoint) for name in "12"]
    recording = tmp_path / "recording.mcap"
    wait_for(lambda: recording.exists() and recording.stat().st_size > 100_000)
    plant.process.kill()
    for agent in agents:
        status, output = agent.finish(timeout=PATIENCE)
        assert status == 0, output


WITHHOLDING = 'agents.0.law={ type = "tests.hostile.withholding:Withholding", gain = 1.0 }'


def test_an_agent_started_by_hand_says_who_withholds_a_broadcast(phalanx, tmp_path):
    endpoint = free_endpoint()
    of_run = ("--set", "time.timeout=10", "--set", "duration=1", "--set", WITHHOLDING)
    common = ("--scenario", "unicycles", "--run", "r", *of_run)
    plant = phalanx("plant", *common, "--listen", endpoint, "--folder", str(tmp_path))
    first, *_ = [phalanx("agent", name, *common, "--connect", endpoint) for name in "12345"]
    status, output = first.finish(timeout=PATIENCE)
    assert status == 3
    assert "Traceback" not in output
    (reason,) = (line for line in output.splitlines() if "waits at sample" in line)
    assert "broadcast 10 of agent 3 did not come. Its sender withholds it" in reason
    assert "see the sender's log" in reason
    assert plant.finish()[0] == 3
    assert "agent 1 waits at sample 11 " in read(tmp_path, trust=True).summary.reason


STARTING = {
    "at once": lambda run: True,
    "when it has a child": lambda run: len(run.descendants()) > 1,
    "when the first program is there": lambda run: run.programs(),
    "when half of the programs are there": lambda run: len(run.programs()) >= 3,
}


@pytest.mark.parametrize(
    "instant", layered(STARTING, ("at once", "when half of the programs are there"))
)
def test_a_launcher_killed_while_it_starts_leaves_no_orphan(phalanx, instant):
    run = phalanx("run", "unicycles", *LONG)
    wait_for(lambda: STARTING[instant](run))
    run.process.kill()
    run.wait_until_gone()


@pytest.mark.parametrize("program", layered(("phx-plant", "phx-agent-3"), ("phx-plant",)))
def test_a_program_killed_at_its_first_instant_ends_the_run(phalanx, program):
    run = phalanx("run", "unicycles", *LONG)
    wait_for(lambda: program in run.programs())
    run.programs()[program].kill()
    assert f"{program} died (killed by SIGKILL)" in run.ends(3)


def test_an_agent_leaves_a_hub_that_is_killed_as_soon_as_it_has_met_it(phalanx, tmp_path):
    """Even one that has not yet seen that the plant is there."""
    endpoint = free_endpoint()
    common = ("--scenario", "one-on-one", "--run", "r")
    plant = phalanx("plant", *common, "--listen", endpoint, "--folder", str(tmp_path))
    wait_for(lambda: "LISTEN" in states(plant))
    agent = phalanx("agent", "1", *common, "--connect", endpoint, "--timeout", "3")
    wait_for(lambda: "ESTABLISHED" in states(agent))
    plant.process.kill()
    agent.finish(timeout=PATIENCE)


def states(run) -> list[str]:
    """Return the states of a command's TCP connections."""
    return [c.status for c in psutil.Process(run.process.pid).net_connections("tcp4")]


@pytest.mark.parametrize(
    ("engine", "missing"),
    [
        ("processes", (1500,)),
        pytest.param("in-process", (150, 1500, 4000), marks=pytest.mark.nightly),
    ],
)
def test_a_disk_that_fills_at_the_end_breaks_the_run(phalanx, engine, missing):
    """A verdict without a whole record of it is none."""
    # So short that the run may be over before its launcher listens, and of a size that hardly
    # changes: solve times differ by a few digits.
    fast = ("one-on-one", "--set", "duration=0.1", "--engine", engine)
    calm = phalanx("run", *fast)
    assert calm.finish()[0] == 0
    whole = (calm.folder / "recording.mcap").stat().st_size
    for short_of in missing:
        run = phalanx("run", *fast, limit=at_most(resource.RLIMIT_FSIZE, whole - short_of))
        output = run.ends(3)
        assert "broken: guaranteed, but not written down to its end" in output.splitlines()[-1]
        assert "recording.mcap" in output.splitlines()[-1]
        assert not (run.folder / "summary.json").exists()
        assert "cut short" in read(run.folder).damage


def test_a_full_disk_breaks_the_run_and_names_the_file(phalanx):
    """A limit on file size is the full disk that needs no root."""
    run = phalanx("run", "unicycles", limit=at_most(resource.RLIMIT_FSIZE, 150_000))
    output = run.ends(3)
    assert "recording.mcap" in output.splitlines()[-1]
    recording = read(run.folder)
    assert "cut short" in recording.damage
    assert recording.steps


@pytest.mark.parametrize(
    ("engine", "reason"),
    [
        ("in-process", "recording.mcap"),
        ("processes", "no program can be started: No usable temporary directory"),
    ],
)
def test_a_disk_without_room_for_any_file_breaks_a_run_in_one_line(phalanx, engine, reason):
    no_room = at_most(resource.RLIMIT_FSIZE, 0)
    output = phalanx("run", "one-on-one", "--engine", engine, limit=no_room).ends(3)
    assert output.startswith("broken: ")
    assert reason in output
    assert len(output.splitlines()) == 1


@pytest.mark.parametrize("megabytes", layered((120, 170), (120,)))
def test_too_little_memory_to_load_ends_in_one_line(phalanx, megabytes):
    limit = at_most(resource.RLIMIT_AS, megabytes * 1_000_000)
    run = phalanx("run", "one-on-one", limit=limit)
    output = run.ends(3)
    assert output.startswith("too little memory")
    assert len(output.splitlines()) == 1


def test_an_agent_that_a_fault_has_killed_is_not_why_the_run_broke(phalanx, tmp_path, monkeypatch):
    (tmp_path / "faulty_law.py").write_text(FAULTY_LAW)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    kill = 'faults=[{ kind = "kill", at = 0.005, agents = ["1"] }]'
    law = 'agents.1.law={ type = "faulty_law:Faulty" }'
    run = phalanx("run", "unicycles", "--set", kill, "--set", law)
    output = run.ends(3)
    text = " ".join(output.split())
    assert re.search(r"Faulty.input: expected no error for agent [45], got RuntimeError: no", text)
    assert "faulty_law.py, line 11" in text
    assert "phx-agent-1 died" not in output
    assert any(line.text.startswith("agent 1 killed") for line in read(run.folder, trust=True).log)


def test_a_second_ctrl_c_ends_a_plant_that_stands_still_and_its_log_says_where(
    phalanx, tmp_path, monkeypatch
):
    """A rule of a user's own may wait for what never comes, whatever signal the plant gets."""
    (tmp_path / "stuck_link.py").write_text(STUCK_LINK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    rules = 'network.sample.rules=[{ type = "stuck_link:Stuck" }]'
    run = phalanx("run", "one-on-one", "--set", rules)
    log = run.folder / "logs" / "plant.log"
    wait_for(lambda: log.exists() and "stuck" in log.read_text())
    times = [-math.inf]

    def no_plant_is_left() -> bool:
        """Else Ctrl-C now and then: of two that come at once the second is not one of its own."""
        over = "phx-plant" not in run.programs()
        if not over and time.monotonic() > times[-1] + 1.5:
            os.killpg(run.process.pid, signal.SIGINT)
            times.append(time.monotonic())
        return over

    wait_for(no_plant_is_left)
    assert "phx-plant died (killed by SIGABRT): stuck; log: " in run.ends(3)
    assert "stuck_link.py" in log.read_text()
    assert read(run.folder, trust=True).steps


def at_most(kind: int, number: int) -> partial[None]:
    """A limit of a process's resource of a kind, to be set in it."""
    return partial(resource.setrlimit, kind, (number, number))


STUCK_LINK = """
import time
from functools import partial
from dataclasses import dataclass
from phalanx.extend import DELIVER

@dataclass(frozen=True)
class Stuck:
    def treat(self, message):
        if message.k == 599:
            print("stuck", flush=True)
            time.sleep(1e6)
        return DELIVER
"""

FAULTY_LAW = """
from dataclasses import dataclass

@dataclass
class Faulty:
    def prepare(self, dynamics):
        self.answers = 0
    def input(self, view):
        self.answers += 1
        if self.answers > 1:  # the first is asked for before any process starts
            raise RuntimeError("no such sensor")
        return view.x[view.i][:2] * 0.0
"""


FAILING = """
import os
from phalanx.extend import TrackVelocity as Base

class TrackVelocity(Base):
    def join(self, i, members, obstacles):
        if members[i].name == "2":
            FAILURE
        return self
"""


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        ('raise RuntimeError("no camera")', "no camera"),
        pytest.param("os.kill(os.getpid(), 9)", "killed by SIGKILL", marks=pytest.mark.nightly),
    ],
    ids=["error", "kill"],
)
def test_an_agent_that_ends_before_it_joins_ends_the_run_at_once_and_is_named(
    phalanx, tmp_path, monkeypatch, failure, message
):
    (tmp_path / "failing_user.py").write_text(FAILING.replace("FAILURE", failure))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    law = "agents.0.law={ type = 'failing_user:TrackVelocity', gain = 1.0 }"
    run = phalanx("run", "unicycles", "--set", law, "--set", "time.timeout=600")
    output = run.ends(3)
    assert "broken: an agent failed [phx-agent-2 died (" in output
    assert message in output


CLOSED = {
    "output": ">&-",
    "errors": "2>&-",
    "all three": "<&- >&- 2>&-",
    "a reader that goes": "| head -1",
    "a reader of errors that goes": "2>&1 >/dev/null | true",
}
RARELY_CLOSED = ("all three", "a reader of errors that goes")


@pytest.mark.parametrize("unbuffered", ["", pytest.param("1", marks=pytest.mark.nightly)])
@pytest.mark.parametrize(
    "closed",
    [
        *("output", "errors", "a reader that goes"),
        *(pytest.param(c, marks=pytest.mark.nightly) for c in RARELY_CLOSED),
    ],
)
def test_whatever_stream_is_closed_the_run_goes_on_to_its_end(tmp_path, closed, unbuffered):
    command = f"{sys.executable} -m phalanx run one-on-one --no-report --set duration=0.2"
    shell = f"set -o pipefail; {command} --out {tmp_path} {CLOSED[closed]}"
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    ended = subprocess.run(["bash", "-c", shell], env=environment, capture_output=True)
    assert ended.returncode == 0, ended.stderr
    recording = read(tmp_path / "one-on-one-1")
    assert recording.damage is None
    assert recording.summary.outcome is Outcome.GUARANTEED


@pytest.mark.parametrize("handles", layered((24, 44), (44,)))
def test_too_few_file_handles_are_said_before_anything_is_started(phalanx, handles):
    run = phalanx("run", "unicycles", limit=at_most(resource.RLIMIT_NOFILE, handles))
    output = run.ends(3)
    assert f"a process may have {handles} file handles" in output
    assert "needs 45: raise the hard limit" in output
    assert not list(run.parent.glob("*/*"))


@pytest.mark.parametrize("soft", layered((45, 24), (45,)))
def test_a_low_limit_of_file_handles_is_raised_where_that_is_allowed_and_45_are_enough(
    phalanx, soft
):
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1] if soft < 45 else soft
    limit = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
    phalanx("run", "unicycles", "--set", "duration=0.2", limit=limit).ends(0)
