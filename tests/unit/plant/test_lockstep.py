"""Lockstep: runs that fail, lookahead, and pauses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.clock.lookahead import look_ahead
from phalanx_plant.judge.event_queue import EventQueue
from phalanx_plant.judge.judge import Judged
from phalanx_plant.sampling.sampling import NoProcesses, Sampling
from phalanx_plant.world.events import (
    CommandApplied,
    Event,
    InputApplied,
    Instant,
    Sampled,
    StateReached,
    SwarmBrokenError,
)
from phalanx_plant.world.world import World

from phalanx.faults.commands import NO_COMMANDS, Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.kinds import Sample, Status, Telemetry
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from tests.unit.plant.runs import plant_run, report
from tests.unit.swarms import rows_of_scenario
from tests.unit.tables import group, swarm_table


@dataclass(frozen=True)
class Runaway(SingleIntegrator):
    """It is infinitely far away after half a second."""

    def drift(self, x):
        return 1e2 * x**3


class Coasting(NoProcesses):
    """Agents that want nothing, in the plane."""

    def __init__(self) -> None:
        self.asked = 0
        self._open = dict[int, Sample]()

    def send_sample(self, i: int, sample: Sample) -> None:
        self._open[i] = sample
        self.asked += 1

    def await_input(self, i: int) -> Array:
        del self._open[i]
        return np.zeros(2)

    def take_input(self, i: int) -> Array | None:
        return self.await_input(i) if i in self._open else None

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        return report(k)

    def publish_status(self, message: Status) -> None:
        pass


@pytest.mark.slow
def test_the_input_before_a_breakdown_is_judged_and_recorded(tmp_path: Path) -> None:
    runaway = group("1", "normal", [[0.5, 0.0]], "track-velocity")
    runaway["dynamics"]["type"] = f"{__name__}:Runaway"
    obstacle = {"center": [0.0, 0.0], "clearance": 0.1}
    scenario = load(swarm_table(runaway, safety={"eta": 0.0}, obstacles=[obstacle]))
    coasting = Coasting()
    summary, recording = plant_run(build_rows(build_swarm(scenario)), coasting, tmp_path)
    assert summary.outcome is Outcome.BROKEN
    assert summary.steps == len(recording.steps) == coasting.asked > 1


def test_an_agent_thawed_while_its_input_is_on_its_way_samples_after_that_took_effect(
    tmp_path: Path,
) -> None:
    rows = rows_of_scenario("one-on-one", "duration=0.2", "time.latency=0.004")
    name, agents = rows.swarm.names[0], Coasting()
    schedule = (Command(0.101, CommandKind.FREEZE, name), Command(0.102, CommandKind.THAW, name))
    summary, _ = plant_run(rows, agents, tmp_path, CommandPolicy(schedule=schedule))
    assert summary.outcome is not Outcome.BROKEN
    assert summary.steps == agents.asked


class Silenced(Coasting):
    """Agents of which the first dies between an input and the report on it."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        if (i, k) == (0, 3):
            raise SwarmBrokenError("agent 1 died: see its log")
        return super().await_telemetry(i, k)


@pytest.mark.slow
def test_a_report_that_never_comes_is_why_the_run_broke_and_shifts_no_other_certificate(
    tmp_path: Path,
) -> None:
    rows = rows_of_scenario("unicycles", "duration=0.3")
    certified, reasons = [], []
    for agents in (Coasting(), Silenced()):
        summary, recording = plant_run(rows, agents, tmp_path)
        reasons.append(summary.reason)
        certified.append({(step.agent, step.k): step.certified for step in recording.steps})
    whole, broken = certified
    assert reasons[1] == "agent 1 died: see its log"
    assert ("1", 3) in whole.keys() - broken.keys()
    assert len(broken) > 12
    assert broken.items() <= whole.items()


CONCURRENT = partial(Lockstep, synchronization=look_ahead)


class Slow(Coasting):
    """Agents whose answers arrive only when the plant waits for them."""

    def __init__(self, wanted: tuple[float, float] = (0.0, 0.0)) -> None:
        super().__init__()
        self.most, self._wanted = 0, wanted

    def send_sample(self, i: int, sample: Sample) -> None:
        super().send_sample(i, sample)
        if sample.t > 0.02:  # at 0 all sample, whatever they see
            self.most = max(self.most, len(self._open))

    def take_input(self, i: int) -> Array | None:
        return None

    def await_input(self, i: int) -> Array:
        super().await_input(i)
        return np.array(self._wanted)


def run_of(agents: Slow, folder: Path, *overrides: str) -> Summary:
    rows = rows_of_scenario("unicycles", "duration=0.3", *overrides)
    return plant_run(rows, agents, folder, clock=CONCURRENT)[0]


@pytest.mark.slow
def test_agents_out_of_each_others_sight_compute_at_once_and_the_trajectory_is_the_same(
    tmp_path: Path,
) -> None:
    durations, near = (1.5, 0.5), ("safety.neighbourhood=4.0", "agents.1.sensing=4.0")
    after_one_another, at_once = Slow(durations), Slow(durations)
    alone = run_of(after_one_another, tmp_path, *near, "time.lookahead=false")
    together = run_of(at_once, tmp_path, *near)
    assert (after_one_another.most, at_once.most) == (1, 5)
    assert together.trajectory == alone.trajectory
    assert together.steps == alone.steps > 120


def test_an_agent_that_sees_everything_waits_for_all(tmp_path: Path) -> None:
    agents = Slow()
    assert run_of(agents, tmp_path, "agents.0.sensing=4.0").outcome is not Outcome.BROKEN
    assert agents.most == 4, "the three normal agents, which see 4 m far, and one that does not"


def test_if_most_agents_see_everything_there_is_no_lookahead(tmp_path: Path) -> None:
    agents = Slow()
    assert run_of(agents, tmp_path, "agents.1.sensing=4.0").outcome is not Outcome.BROKEN
    assert agents.most == 1


@pytest.mark.slow
def test_dynamics_that_travel_farther_than_they_say_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Unicycle, "travel", lambda *_: 0.0)
    summary = run_of(Slow((4.0, 0.0)), tmp_path, "safety.neighbourhood=4.7", "agents.1.sensing=4.0")
    assert summary.outcome is Outcome.BROKEN
    assert "travel farther than" in summary.reason


class Watched(EventQueue):
    """All events that were added, and those that were judged."""

    def __init__(self, agents: Coasting) -> None:
        super().__init__(self, agents.await_telemetry, [self.observe])
        self.added, self.judged = list[type[Event]](), list[type[Event]]()

    def add(self, instant: Instant) -> None:
        super().add(instant)
        self.added += map(type, instant)

    def observe(self, events: Sequence[Judged]) -> None:
        self.judged += [type(judged.event) for judged in events]

    def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        judged += map(Judged, events)


class PausedNowAndThen(CommandQueue):
    """Virtual time waits before each event, and counts the events judged by then."""

    def __init__(self, events: Watched) -> None:
        super().__init__(NO_COMMANDS, ())
        self.seen, self._events = list[int](), events

    def wait_until(self, t: float, now: float, idle: Callable[[], None]) -> list[Command]:
        idle()
        assert self._events.judged == self._events.added
        self.seen.append(len(self._events.judged))
        return super().wait_until(t, now, idle)


def test_while_virtual_time_waits_all_events_have_been_judged() -> None:
    rows, agents = rows_of_scenario("unicycles", "duration=0.1"), Coasting()
    events = Watched(agents)
    swarm, commands = rows.swarm, PausedNowAndThen(events)
    run = Lockstep(World(rows), Sampling(swarm), agents, events, commands)
    run.run(swarm.scenario.duration)
    assert commands.seen == sorted(set(commands.seen))
    assert events.judged == events.added


def test_a_command_takes_effect_before_the_samples_of_its_instant() -> None:
    rows, agents = rows_of_scenario("unicycles", "duration=0.1"), Coasting()
    events, swarm = Watched(agents), rows.swarm
    policy = CommandPolicy(schedule=(Command(0.0, CommandKind.LOSS, value=0.5),))
    commands = CommandQueue(policy, swarm.names)
    Lockstep(World(rows), Sampling(swarm), agents, events, commands).run(0.1)
    kinds = [StateReached, CommandApplied, *[Sampled] * 5, *[InputApplied] * 5]
    assert events.added[: len(kinds)] == kinds
