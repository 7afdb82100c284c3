"""Runs by the wall clock, with real agents: their results, and repeatable decisions.

Nothing here depends on the speed of the machine: slow agents miss samples and are late.
"""

import copy
import math
import os
import signal
import statistics
from dataclasses import replace

import pytest

from phalanx import EngineError
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.engine import RunOptions, execute
from phalanx.launcher.verify import verify
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from tests.process.runs import wait_for

pytestmark = pytest.mark.swarm

DELAY = 0.03


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Two seconds of Simulation 1 at a third of the wall clock's pace, on a slow network."""
    folder = tmp_path_factory.mktemp("real-time")
    scenario = load("unicycles", ["duration=2.0", f"network.delay={DELAY}"])
    execute(scenario, folder, RunOptions(real_time=0.3))
    return read(folder)


def test_the_wall_clock_sets_the_pace(recorded: Recording) -> None:
    summary = recorded.summary
    assert summary is not None
    assert summary.outcome in (Outcome.SAFE, Outcome.VIOLATED)
    assert summary.t == 2.0
    assert summary.wall_time >= 2.0 / 0.3


def test_every_input_is_late_where_none_may_take_time(recorded: Recording) -> None:
    punctuality = recorded.summary.punctuality
    assert punctuality.late == len(recorded.steps) > 100
    assert all(step.t_apply > step.t for step in recorded.steps)
    assert punctuality.samples >= len(recorded.steps)
    assert all(m.p50 <= m.p99 <= m.most for m in punctuality.measured)


def test_a_declared_delay_comes_on_top_of_the_transports(recorded: Recording) -> None:
    delays = [delay for step in recorded.steps for _, _, delay in step.fates]
    assert len(delays) > 100
    assert min(delays) >= DELAY
    assert statistics.median(delays) > DELAY


def test_every_decision_can_be_made_again_from_what_was_shown(recorded: Recording) -> None:
    verification = verify(recorded)
    assert verification
    assert verification.steps == len(recorded.step_data) == len(recorded.steps)
    assert any(shown.received for shown in recorded.step_data)


@pytest.mark.parametrize("what", ["x", "received"])
def test_a_last_digit_of_what_was_shown_makes_another_decision(
    recorded: Recording, what: str
) -> None:
    forged = replace(recorded, step_data=copy.deepcopy(recorded.step_data))
    sample = next(s for s in forged.step_data if s.agent == "1" and s.received and s.t > 1.0)
    if what == "x":
        sample.x = [math.nextafter(value, math.inf) for value in sample.x]
    else:
        sample.received = [(l, math.nextafter(since, 0.0), u) for l, since, u in sample.received]
    difference = verify(forged).difference
    assert difference is not None
    assert f"agent 1, k = {sample.k}," in difference


def test_by_radio_decisions_can_be_made_again_and_agents_know_the_starts(tmp_path) -> None:
    options = RunOptions(real_time=0.2)
    execute(load("radio", ["duration=1.0", "agents.0.radio.every=4"]), tmp_path, options)
    recorded = read(tmp_path)
    assert verify(recorded)
    assert any(shown.received for shown in recorded.step_data)
    assert recorded.steps[0].origin == "qp", "it did not stand, not knowing where others are"
    forged = copy.deepcopy(recorded.step_data)
    sample = next(shown for shown in forged if shown.received)
    sample.received = [(l, math.nextafter(since, 0.0), u) for l, since, u in sample.received]
    with pytest.raises(EngineError, match="never stated"):
        verify(replace(recorded, step_data=forged))


FAILING_LAW = """
from dataclasses import dataclass
from pathlib import Path

@dataclass
class Failing:
    def prepare(self, dynamics):
        pass
    def input(self, view):
        if Path("fail").exists():
            raise RuntimeError("no camera")
        return view.x[view.i][:2] * 0.0
"""


@pytest.mark.parametrize("end", ["killed", pytest.param("failed", marks=pytest.mark.nightly)])
def test_an_agent_that_dies_is_lost_and_the_run_goes_on(
    phalanx, tmp_path, monkeypatch, end: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "failing_law.py").write_text(FAILING_LAW)
    law = 'agents.1.law={ type = "failing_law:Failing" }'
    common = ("run", "one-on-one", "--real-time", "1", "--set", "duration=600")
    run = phalanx(*common, *(("--set", law) if end == "failed" else ()))
    run.wait_until_running(agents=2)
    if end == "killed":
        run.programs()["phx-agent-2"].kill()
    (tmp_path / "fail").touch()

    def steps_without_it() -> int:
        recording = read(run.folder, trust=True)
        lost = [line.t for line in recording.log if line.text.startswith("agent 2 is lost")]
        # Longer than the plant has to notice a failure, which the launcher tells it too.
        later = lost[0] + 2.0 if lost else math.inf
        return sum(step.agent == "1" and step.t > later for step in recording.steps)

    wait_for(lambda: steps_without_it() or run.process.poll() is not None)
    os.killpg(run.process.pid, signal.SIGINT)
    run.ends(130)
    assert read(run.folder, trust=True).summary.outcome is Outcome.STOPPED


def test_another_process_takes_the_place_of_one_that_died(phalanx) -> None:
    run = phalanx("run", "faults/restart", "--real-time", "1", "--set", "duration=600")

    def times(text: str) -> list[float]:
        return [line.t for line in read(run.folder).log if line.text.startswith(text)]

    def decides_again() -> bool:
        back = times("agent 1 is back")
        steps = read(run.folder).steps
        return bool(back) and any(step.agent == "1" and step.t > back[0] for step in steps)

    run.wait_until_running(agents=4)
    wait_for(decides_again)
    os.killpg(run.process.pid, signal.SIGINT)
    assert run.finish()[0] == 130
    assert times("agent 1 killed") < times("agent 1 is back")
    assert verify(read(run.folder))
