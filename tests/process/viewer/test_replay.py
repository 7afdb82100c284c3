"""A recording shows what the live run showed."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from phalanx.faults.commands import CommandKind
from phalanx.recording.read import read
from phalanx.scenario.load import load
from phalanx.viewer.feeds.history import LEAST_HORIZON, certified_horizon, swarm_horizons
from phalanx.viewer.feeds.replay import Replay, open_replay
from phalanx.viewer.scene.picture import picture
from phalanx.wire.frames import Frame
from tests.process.runs import PACED, live_run, wait_for

pytestmark = pytest.mark.swarm


@pytest.fixture(scope="module")
def replay(finished: Path) -> Replay:
    return open_replay(finished)


def test_a_replay_shows_what_was_seen_live(tmp_path: Path) -> None:
    with (
        live_run(load("unicycles", ["duration=2.0"]), tmp_path / "live", PACED) as run,
        run.watch() as live,
    ):
        seen: list[Frame] = []

        def paused() -> bool:
            seen.extend(frame for frame in [live.take()] if frame)
            return bool(seen) and seen[-1].paused

        wait_for(lambda: live.take())
        live.command(CommandKind.FREEZE, agent="4")
        live.command(CommandKind.PAUSE)
        wait_for(paused)
        live.command(CommandKind.SPEED)
        live.command(CommandKind.RESUME)
        summary = run.summary()
    live_frame, again = seen[-1], open_replay(tmp_path / "live").frame(seen[-1].t)
    assert again.t == live_frame.t
    assert again.x == live_frame.x
    assert again.agents == live_frame.agents
    assert again.pair == live_frame.pair
    assert again.worst_h == live_frame.worst_h
    assert read(tmp_path / "live").summary == summary


def test_the_plot_of_certified_times_keeps_the_shortest_and_leaves_adversaries_out(
    replay: Replay, finished: Path
) -> None:
    recorded = [s.certified for s in read(finished).steps if s.agent == "1"]
    rows, tau = replay.history.agent(0), replay.model.swarm.horizon(0)
    assert list(rows[:, 4]) == recorded
    t, horizon = certified_horizon(rows, tau, 20)
    assert len(t) == len(horizon) == 20
    assert horizon.min() == max(min(recorded) / tau, LEAST_HORIZON)
    assert set(t) <= set(rows[:, 0])
    assert len(certified_horizon(replay.history.agent(4), tau, 20)[0]) == 0


def test_stepping_goes_from_state_to_state(replay: Replay) -> None:
    replay.seek(1.0)
    before = replay.t
    replay.step(1)
    stepped = replay.t
    assert stepped > before
    assert stepped == replay.times[np.searchsorted(replay.times, before, side="right")]
    replay.step(-1)
    assert replay.t <= before


def test_a_replay_says_whether_it_plays(replay: Replay) -> None:
    replay.seek(0.0)
    replay.play(True)
    wait_for(lambda: (frame := replay.take()) and not frame.paused)
    replay.play(False)
    stopped = replay.take()
    assert stopped is not None
    assert stopped.paused
    assert replay.take() is None


def test_what_an_agent_applied_is_what_the_recording_says(replay: Replay, finished: Path) -> None:
    steps = [step for step in read(finished).steps if step.agent == "2"]
    for step, following in pairwise(steps[50:61]):
        between = (step.t_apply + following.t_apply) / 2.0
        assert list(replay.frame(between).agents[1].u) == step.u


def test_lost_and_late_broadcasts_are_drawn_as_links(replay: Replay) -> None:
    pictures = [picture(replay.model, replay.frame(t)) for t in np.arange(0.5, 3.5, 0.1)]
    lost = np.concatenate([shown.lost for shown in pictures])
    assert sum(len(shown.links) for shown in pictures) == len(lost)
    assert 0.2 < lost.mean() < 0.95  # the others were late


def test_of_the_links_those_of_one_agent_can_be_told_apart(replay: Replay) -> None:
    times = replay.times[::20]
    shown = next(p for t in times if len((p := picture(replay.model, replay.frame(t))).links) > 3)
    for i in range(3):
        ends = shown.links == shown.positions[i]
        np.testing.assert_array_equal(shown.links_of(i), ends.all(axis=2).any(axis=1))
    assert shown.links_of(0).any()
    assert not shown.links_of(None).any()


def test_the_marks_lead_to_the_worst_moment_and_the_first_backup(
    replay: Replay, finished: Path
) -> None:
    marks = {mark.text.split(",")[0]: mark.t for mark in replay.marks}
    worst = replay.frame(marks["worst moment"])
    assert worst.h_tot == worst.worst_h == max(read(finished).h_tot)
    first = marks["first backup"]
    assert sum(a.backups for a in replay.frame(first).agents) == 1
    backups = [s.t_apply for s in read(finished).steps if s.origin == "backup"]
    assert first == min(backups)


def test_the_swarms_certified_times_are_the_shortest_and_the_median_of_the_inputs_in_force(
    replay: Replay, finished: Path
) -> None:
    rows, recording = replay.history.swarm.rows, read(finished)
    for row in rows[:: len(rows) // 7]:
        in_force = [
            max((s for s in recording.steps if s.agent == n and s.t_apply <= row[0]),
                key=lambda s: s.t_apply).certified / replay.model.swarm.horizon(i)
            for i, n in enumerate("123")
        ]  # fmt: skip
        assert list(row[3:5]) == pytest.approx([min(in_force), np.median(in_force)])
    t, shortest, median = swarm_horizons(rows, 20).T
    assert len(t) == 20
    assert shortest.min() == max(rows[:, 3].min(), LEAST_HORIZON)
    assert (shortest <= median).all()
