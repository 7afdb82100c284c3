"""Real time on a wall clock that the test turns: what is late, missed or given up."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from phalanx_certify.checker.certify import certify
from phalanx_plant.clock.real_time import RealTime

from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.kinds import Sample, Status, Telemetry
from phalanx.recording.read import Recording
from phalanx.theory.arrays import Array
from tests.unit.plant.runs import plant_run, report
from tests.unit.swarms import rows_of_scenario

LATENCY = 0.004
PERIOD = 0.01
RESTART = CommandKind.RESTART
STILL = ("agents.0.clock.jitter=0.0", "agents.1.clock.jitter=0.0")
Takes = Callable[[int, int], float | None]
"""How long agent i takes to answer sample k [s of wall time]; None: for ever."""


class OnTheWall:
    """Agents that take their time, and the wall clock: it goes on while the plant listens."""

    waiting = 0

    def __init__(self, takes: Takes) -> None:
        self.wall, self.samples = 100.0, list[tuple[int, Sample]]()
        self._takes, self._coming = takes, dict[int, float]()
        self.changes = list[tuple[float, int, bool]]()
        self.still, self.steps = list[int](), list[int]()
        self.restarts, self.back = list[int](), True

    def send_sample(self, i: int, sample: Sample) -> None:
        self.samples.append((i, sample))
        takes = self._takes(i, sample.k)
        self._coming[i] = self.wall + (1e9 if takes is None else takes)

    def listen(self, seconds: float) -> None:
        comes = min(self._coming.values(), default=1e9)
        self.wall = max(self.wall, min(self.wall + max(seconds, 0.0), comes)) + 1e-6

    def take_reported(self, i: int) -> Array | None:
        if self._coming[i] > self.wall:
            return None
        del self._coming[i]
        return np.array([0.1, 0.0])

    def take_changes(self) -> list[tuple[int, bool, str]]:
        due = [c for c in self.changes if c[0] <= self.wall - 100.0]
        self.changes = [c for c in self.changes if c not in due]
        return [(i, back, "") for _, i, back in due]

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        return report(k)

    def publish_status(self, message: Status) -> None:
        self.steps.append(message.steps)

    def pause(self, i: int, t: float) -> None:
        self.still.append(i)

    def resume(self, i: int, t: float) -> None:
        self.still.remove(i)

    def kill(self, i: int, order: Sample) -> None:
        self.back = False

    def restart(self, i: int, t: float) -> None:
        self.restarts.append(i)
        if len(self.restarts) == 2:
            self.back = True
            self.changes.append((self.wall - 100.0, i, True))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def start(
        agents: OnTheWall, *commands: Command, factor: float = 1.0, duration: float = 0.2
    ) -> tuple[Summary, Recording]:
        monkeypatch.setattr(time, "monotonic", lambda: agents.wall)
        overrides = (f"duration={duration}", f"time.latency={LATENCY}", *STILL)
        rows = rows_of_scenario("one-on-one", *overrides)
        policy = CommandPolicy(commands, speed=factor)
        return plant_run(rows, agents, tmp_path, policy, RealTime)

    return start


def test_inputs_that_are_there_in_time_take_effect_when_they_are_due(run) -> None:
    summary, recording = run(OnTheWall(lambda i, k: 0.002))
    assert all(step.t_apply == step.t + LATENCY for step in recording.steps)
    first, last = min(step.t_apply for step in recording.steps), recording.states[-1]
    moved = last.x[0] - recording.states[0].x[0]
    assert moved == pytest.approx(0.1 * (last.t - first), abs=0.1 * PERIOD + 1e-3)
    punctuality = summary.punctuality
    assert (punctuality.missed, punctuality.late, punctuality.unanswered) == (0, 0, 0)
    assert punctuality.samples >= 2 * 0.2 / PERIOD
    assert punctuality.measured[-1].p50 == pytest.approx(0.002, abs=1e-5)


@pytest.mark.slow
def test_its_recording_begins_at_the_start_and_is_certified(run) -> None:
    summary, recording = run(OnTheWall(lambda i, k: 0.002))
    assert recording.states[0].t == 0.0
    report = certify(recording.scenario, recording.states, recording.steps)
    assert summary.certificates.uncovered is None
    assert report.gap is None
    assert report.samples > 15
    of_before = certify(recording.scenario, recording.states[1:], recording.steps)
    assert of_before.gap.t == 0.0


@pytest.mark.slow
def test_a_late_input_takes_effect_when_it_comes_and_is_counted(run) -> None:
    summary, recording = run(OnTheWall(lambda i, k: 0.007 if (i, k) == (0, 3) else 0.001))
    (late,) = [step for step in recording.steps if step.t_apply > step.t + LATENCY]
    assert late.k == 3
    assert late.t_apply - late.t == pytest.approx(0.007, abs=1e-5)
    assert summary.punctuality.late == 1
    assert next(a for a in summary.assumptions if a.name == "inputs in time").failed == 1


@pytest.mark.slow
def test_who_owes_an_answer_misses_the_ticks_of_its_clock(run) -> None:
    agents = OnTheWall(lambda i, k: 0.035 if (i, k) == (0, 3) else 0.001)
    summary, _ = run(agents)
    gaps = [b.t - a.t for (_, a), (_, b) in zip(of(agents, 0), of(agents, 0)[1:], strict=False)]
    assert summary.punctuality.missed == 3
    assert summary.punctuality.measured[1].most < 1e-4, "what was missed is not off its period"
    assert max(gaps) == pytest.approx(4 * PERIOD, abs=1e-4)
    assert [s.k for _, s in of(agents, 0)] == list(range(len(of(agents, 0))))


@pytest.mark.slow
def test_who_never_answers_is_sampled_again_after_a_while(run) -> None:
    agents = OnTheWall(lambda i, k: None if (i, k) == (0, 3) else 0.001)
    still = Command(0.012, CommandKind.FREEZE, "1"), Command(0.022, CommandKind.THAW, "1")
    summary, recording = run(agents, *still, duration=1.5)
    assert summary.punctuality.unanswered == 1
    assert not agents.restarts, "its process is there"
    assert 4 in [step.k for step in recording.steps if step.agent == "1"]
    assert 3 not in [step.k for step in recording.steps if step.agent == "1"]


@pytest.mark.slow
def test_a_restart_is_asked_for_until_the_process_is_back(run) -> None:
    """A request may come before the dead process is gone, and change nothing."""
    agents = OnTheWall(lambda i, k: None if i == 0 and not agents.back else 0.001)
    dead = [Command(t, kind, "1") for t, kind in ((0.02, CommandKind.KILL), (0.1, RESTART))]
    run(agents, *dead, duration=3.5)
    assert agents.restarts == [0, 0], "none is asked for once it is back"


def test_the_factor_says_how_fast_virtual_time_goes(run) -> None:
    agents = OnTheWall(lambda i, k: 1e-4)
    summary, _ = run(agents, factor=0.5)
    assert summary.wall_time == pytest.approx(0.2 / 0.5, rel=0.01)
    assert agents.steps[2] > 0, "events are judged while it runs"


def test_commands_take_effect_at_their_times_and_lost_agents_are_reported(run) -> None:
    agents = OnTheWall(lambda i, k: 1e-4)
    agents.changes = [(0.1, 1, False), (0.15, 1, True)]
    summary, recording = run(agents, Command(0.05, CommandKind.FREEZE, "1"))
    assert max(s.t for _, s in of(agents, 0)) < 0.05
    assert agents.still == [0]
    assert max(s.t for _, s in of(agents, 1)) > 0.18
    texts = [line.text for line in recording.log]
    assert texts[:2] == ["agent 1 frozen", "agent 2 is lost; its actuator holds its input"]
    assert texts[2] == "agent 2 is back"
    assert summary.outcome is not Outcome.BROKEN


class Stalled(OnTheWall):
    """Once the plant gets no time for 20 ms."""

    def listen(self, seconds: float) -> None:
        answered = 0 not in self._coming and self.wall > 100.0915
        super().listen(seconds)
        if answered and self.wall < 100.0965:
            self.wall += 0.02


def test_inputs_that_became_due_meanwhile_take_effect_in_the_order_of_their_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Agent 2 samples at 90 ms, and its answer is late; agent 1 samples and answers at 91 ms."""
    agents = Stalled(lambda i, k: 0.006 if i else 0.001)
    monkeypatch.setattr(time, "monotonic", lambda: agents.wall)
    changes = (*STILL, "agents.0.clock.period=0.013", "duration=0.2", f"time.latency={LATENCY}")
    rows = rows_of_scenario("one-on-one", *changes)
    _, recording = plant_run(rows, agents, tmp_path, CommandPolicy(speed=1.0), RealTime)
    applied = {step.agent: step.t_apply for step in recording.steps if 0.0895 < step.t < 0.092}
    assert applied["1"] == pytest.approx(0.091 + LATENCY, abs=1e-4)
    assert applied["2"] > 0.11
    assert {*applied.values()} <= {state.t for state in recording.states}


def of(agents: OnTheWall, i: int) -> list[tuple[int, Sample]]:
    return [(j, sample) for j, sample in agents.samples if j == i]
