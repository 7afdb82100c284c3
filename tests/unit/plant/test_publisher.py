"""Live frames are those of a replay at the same time."""

import time
from pathlib import Path

import pytest
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.judge import event_queue
from phalanx_plant.observers import publisher
from phalanx_plant.run import PlantRun
from phalanx_viewer.feeds.live_history import LiveHistory
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.scene.model import scene_model

from phalanx.faults.commands import NO_COMMANDS, Command, CommandKind, CommandPolicy, Condition
from phalanx.launcher.engine import silent
from phalanx.launcher.simulation import DirectAgents
from phalanx.messages.frames import Frame
from phalanx.messages.kinds import Status
from phalanx.swarm.runnable import compile_rows
from phalanx.theory.arrays import Array
from tests.unit.plant.runs import plant_run
from tests.unit.swarms import rows_of_scenario


class LateAgents(DirectAgents):
    """Agents whose answers are there when they are awaited alone: the plant shows frames before."""

    def take_input(self, i: int) -> Array | None:
        return None


class Audience:
    heard = True

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def put(self, frame: Frame) -> None:
        self.frames.append(frame)


@pytest.mark.slow
@pytest.mark.parametrize(("agents_of", "longest"), [(LateAgents, 0.0), (DirectAgents, 1e9)])
def test_a_frame_shows_what_a_replay_does_at_its_time(
    agents_of: type[DirectAgents], longest: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However late answers arrive, and however many events wait to be judged."""
    monkeypatch.setattr(publisher, "_EVERY", 0.0)
    monkeypatch.setattr(event_queue, "_LONGEST", longest)
    lie = '{kind="lie", agent="2", says="opposite", for=1.0}'
    rows = rows_of_scenario("unicycles", "duration=1.5", "time.latency=0.002", f"faults=[{lie}]")
    schedule = tuple(
        Command(t=t, kind=kind, agent="4")
        for kind, t in ((CommandKind.FREEZE, 0.5), (CommandKind.THAW, 1.0))
    )
    agents, audience = agents_of(rows, silent), Audience()
    policy = CommandPolicy(schedule=schedule)
    _, recording = plant_run(rows, agents, tmp_path, policy, audience=audience)
    replay = open_replay(recording.path)
    assert len(audience.frames) > 100
    for frame in audience.frames:
        again = replay.frame(frame.t)
        assert (frame.t, frame.agents) == (again.t, again.agents)
        assert (frame.x, frame.pair, frame.worst_h) == (again.x, again.pair, again.worst_h)
        assert (frame.h_tot, frame.h) == (again.h_tot, again.h)
    last = audience.frames[-1].agents
    assert sum(agent.backups for agent in last) > 0
    assert last[1].lies > 0


@pytest.mark.slow
@pytest.mark.parametrize(("tell_all_every", "nth"), [(1e9, 1), (0.0, 7)])
def test_frames_bring_the_beliefs_of_a_replay_and_make_up_for_lost_ones(
    tell_all_every, nth, tmp_path, monkeypatch
):
    monkeypatch.setattr(publisher, "_EVERY", 0.0)
    monkeypatch.setattr(event_queue, "_LONGEST", 0.0)
    monkeypatch.setattr(publisher, "_TELL_ALL_EVERY", tell_all_every)
    crash = '[{kind = "restart", at = 0.6, for = 0.3, agents = ["2"]}]'
    rows, audience = rows_of_scenario("radio", "duration=1.3", f"faults={crash}"), Audience()
    _, recording = plant_run(rows, DirectAgents(rows, silent), tmp_path, audience=audience)
    replay, live = open_replay(recording.path), LiveHistory(scene_model(recording.scenario))
    for number, frame in enumerate(frames := audience.frames[::nth]):
        live.add(frame)
        if number % (len(frames) // 8) == 0 and frame.agents[1].condition is Condition.FINE:
            of_live, of_replay = (feed.at(1, frame.t) for feed in (live.beliefs, replay.radio))
            of_peer = {b.peer: (b.age, *b.corners.ravel()) for b in of_replay}
            assert {b.peer: (b.age, *b.corners.ravel()) for b in of_live} == of_peer
    assert [len(live.beliefs.at(1, t)) for t in (0.59, 0.8)] == [7, 0]
    assert any(event.delay < 0.0 for frame in frames for event in frame.link_events), "one is lost"


@pytest.mark.slow
def test_of_violations_frames_bring_first_the_one_that_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frozen robot drives through one obstacle and ends in another."""
    monkeypatch.setattr(publisher, "_EVERY", 0.0)
    monkeypatch.setattr(event_queue, "_LONGEST", 0.0)
    obstacles = ", ".join(
        f"{{center = [{x}, 0.0], clearance = {r}}}" for x, r in ((3, 0.5), (6, 1))
    )
    changes = "agents.0.goal=[[9.0, 0.0]]", "agents.0.dynamics.speed=8.0"
    rows = rows_of_scenario("one-on-one", "duration=0.75", f"obstacles=[{obstacles}]", *changes)
    policy, audience = CommandPolicy((Command(0.1, CommandKind.FREEZE, "1"),)), Audience()
    plant_run(rows, DirectAgents(rows, silent), tmp_path, policy, audience=audience)
    assert [violation.end is None for violation in audience.frames[-1].violations] == [True, False]


@pytest.mark.slow
def test_the_real_time_factor_counts_no_time_before_all_have_joined(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(publisher, "_STATUS_EVERY", 0.0)
    rows = rows_of_scenario("unicycles", "duration=0.5")
    statuses: list[tuple[Status, float]] = []
    joined: list[float] = []

    def join() -> None:
        compile_rows(rows)
        joined.append(time.monotonic())

    agents = DirectAgents(rows, lambda status: statuses.append((status, time.monotonic())))
    commands = CommandQueue(NO_COMMANDS, rows.swarm.names)
    PlantRun(rows, agents, None, commands, Lockstep).run(prepare=join)
    assert statuses[-1][0].t > 0.0
    assert all(status.real_time_factor * (now - joined[0]) >= status.t for status, now in statuses)
