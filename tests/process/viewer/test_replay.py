"""A recording shows what the live run showed."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from phalanx_viewer.feeds.replay import Replay, open_replay
from phalanx_viewer.plots.plots import Content, content, values_at
from phalanx_viewer.scene.picture import Picture

from phalanx.recording.read import read
from phalanx.scenario.load import load
from tests.process.runs import PACED, live_run, wait_for

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


@pytest.fixture(scope="module")
def replay(finished: Path) -> Replay:
    return open_replay(finished)


def test_the_number_at_a_plot_is_the_runs_and_not_its_thinned_curves(replay: Replay) -> None:
    plots = content(replay, range(5), seekable=True)
    bold = {
        plot.title
        for plot in plots.plots
        if plot.agent in (None, 0) and any(c.role == "chosen" or c.agent == 0 for c in plot.curves)
    }
    for t in np.linspace(0.0, replay.end, 7):
        frame = replay.frame(float(t))
        values = values_at(replay, frame, 0, plots.pair)
        assert bold == set(values)
        assert values["h_tot"] == frame.h_tot
        assert values["Residual of the row"] == frame.agents[0].step.residual


def test_a_live_run_marks_violations_as_they_happen(tmp_path: Path) -> None:
    folder = tmp_path / "live"
    with live_run(load("surrounded", ["duration=1.5"]), folder, PACED) as run, run.watch() as live:

        def marked() -> set[tuple[float, str]]:
            live.take()
            return violations(content(live, [0], seekable=False))

        live_marks = wait_for(marked)
        assert live.summary is None
        run.set_speed(0.0)
        run.summary()
    assert live_marks <= violations(plotted(open_replay(folder)))


def violations(content: Content) -> set[tuple[float, str]]:
    return {(mark.t, mark.text) for mark in content.marks if mark.kind == "violation"}


def plotted(replay: Replay) -> Content:
    return content(replay, range(5), seekable=True)


def test_the_marks_are_the_worst_moment_and_the_first_backup(
    replay: Replay, finished: Path
) -> None:
    marks = {mark.kind: mark.t for mark in plotted(replay).marks}
    worst = replay.frame(marks["worst"])
    assert worst.h == worst.worst_h == max(read(finished).h)
    backups = [s.t_apply for s in read(finished).steps if s.origin == "backup"]
    assert marks["backup"] == min(backups)
    assert sum(a.backups for a in replay.frame(marks["backup"]).agents) == 1


def test_what_an_agent_applied_is_what_the_recording_says(replay: Replay, finished: Path) -> None:
    steps = [step for step in read(finished).steps if step.agent == "2"]
    for step, following in pairwise(steps[50:61]):
        between = (step.t_apply + following.t_apply) / 2.0
        assert replay.frame(between).agents[1].step.u == step.u


def test_lost_and_late_broadcasts_are_drawn_as_links(replay: Replay) -> None:
    pictures = [Picture(replay.model, replay.frame(t)) for t in np.arange(0.5, 3.5, 0.1)]
    lost = np.concatenate([shown.lost for shown in pictures])
    assert sum(len(shown.links) for shown in pictures) == len(lost)
    assert 0.2 < lost.mean() < 0.95  # the others were late


def test_the_links_of_one_agent_can_be_selected(replay: Replay) -> None:
    times = replay.times[::20]
    picture = next(p for t in times if len((p := Picture(replay.model, replay.frame(t))).links) > 3)
    for i in range(3):
        ends = picture.links == picture.positions[i]
        np.testing.assert_array_equal(picture.links_of(i), ends.all(axis=2).any(axis=1))
    assert picture.links_of(0).any()
    assert not picture.links_of(None).any()
