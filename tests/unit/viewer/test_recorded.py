"""A replay shows at each time what had happened by then."""

import gc
import sys
import weakref
from collections.abc import Sequence

import numpy as np
import pytest
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import agent_text
from phalanx_viewer.plots.plots import content
from phalanx_viewer.scene.picture import Picture

import phalanx
from phalanx.faults.commands import Command, CommandKind, CommandPolicy, Condition

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def frozen() -> phalanx.Run:
    """Simulation 1 with agent 2 frozen for half a second."""
    orders = ((CommandKind.FREEZE, 0.5), (CommandKind.THAW, 1.0))
    schedule = tuple(Command(t=t, kind=kind, agent="2") for kind, t in orders)
    scenario = phalanx.load("unicycles", ["duration=1.5"])
    commands = CommandPolicy(schedule=schedule)
    return phalanx.run(scenario, engine="in-process", commands=commands)


@pytest.fixture(scope="module")
def replay(frozen: phalanx.Run) -> Replay:
    return Replay(frozen.recording)


def test_at_t_0_a_replay_counts_what_had_happened_at_t_0(replay, frozen):
    first, last = replay.frame(0.0), replay.frame(replay.end)
    assert first.steps == sum(step.t_apply <= 0.0 for step in frozen.recording.steps)
    assert first.steps < last.steps == len(frozen.recording.steps)
    backups = [s for s in frozen.recording.steps if s.origin == "backup" and s.t_apply <= 0.0]
    assert sum(a.backups for a in first.agents) == len(backups)
    assert first.assumptions == ()
    assert [line.t for line in first.log] == [t for t in frozen.events["t"] if t <= 0.0]


def test_how_often_an_assumption_failed_is_shown_at_the_end_alone(replay, frozen):
    failed = [a for a in frozen.summary.assumptions if a.failed]
    assert failed
    assert replay.frame(replay.end).assumptions == tuple(failed)
    by_then = replay.frame(failed[0].first).assumptions
    assert [a.name for a in by_then] == [a.name for a in failed if a.first <= failed[0].first]
    assert {(a.failed, a.checked) for a in by_then} == {(1, 0)}


def test_a_freeze_and_a_thaw_change_the_agents_condition(replay):
    assert [(c.t, c.agent, c.condition) for c in replay.history.conditions] == [
        (0.5, 1, Condition.FROZEN),
        (1.0, 1, Condition.FINE),
    ]


def test_a_liar_is_marked_from_its_first_lie_on():
    recording = phalanx.run(phalanx.load("faults/lie-input"), engine="in-process").recording
    replay = Replay(recording)
    first = min(step.t_apply for step in recording.steps if step.false)
    before, after, end = (replay.frame(t) for t in (first - 1e-3, first, replay.end))
    assert not Picture(replay.model, before).liars.any()
    assert Picture(replay.model, after).liars.tolist() == [False, True, False]
    assert end.agents[1].lies == sum(len(step.false) for step in recording.steps)
    assert f"{end.agents[1].lies} false broadcasts" in agent_text(end.agents[1])


def most_references(objects: Sequence[object]) -> int:
    return max(sys.getrefcount(each) for each in objects)


def test_a_replay_keeps_arrays_and_none_of_the_recordings_records():
    scenario = phalanx.load("formation3d", ["duration=0.2", "network.loss=0.2"])
    recording = phalanx.run(scenario, engine="in-process").recording
    records, alive = [*recording.states, *recording.steps], weakref.ref(recording)
    replay = Replay(recording)
    del recording
    content(replay, range(4), seekable=True)
    gc.collect()
    assert alive() is None
    assert most_references(records) == most_references([object()])
    assert np.shares_memory(replay.history.positions, replay.history.trajectory)


def test_one_that_stands_though_it_wants_to_move_is_in_the_log_and_on_the_timeline():
    facing = {"agents.0.start": [[1.0, 0.0], [-1.0, 0.0]], "agents.0.goal": [[-3, 0], [3, 0]]}
    two = {"agents.0.names": ["a", "b"], "duration": 6.0, "agents.0.law.type": "track-velocity"}
    scenario = phalanx.load("evidence/explanation/swap.toml", {**two, **facing})
    replay = Replay(phalanx.run(scenario, engine="in-process").recording)
    lines = [line for line in replay.log if "though it wants to move" in line.text]
    assert [line.text.split()[1] for line in lines] == ["a", "b"]
    assert lines[0].text.endswith("held by: b")
    marks = content(replay, [0], seekable=True).marks
    assert {line.t for line in lines} <= {mark.t for mark in marks}
