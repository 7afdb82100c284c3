"""Links: their statistics, and the space-time diagram; and the numbers that figures show."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb

import phalanx
from phalanx.recording.curves.history import FATES, IN_TIME, LATE, LOST, ReportHistory, broadcasts
from phalanx.recording.read import Recording, read, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.links import _DOTS, link_statistics, space_time
from phalanx.scenario.model import Scenario
from phalanx.theory.rows.origin import Origin
from tests.unit.report.recordings import drift, fate, record, summary_of, swarm_in_space, unicycles

SILENT_FROM, SILENT_UNTIL = 0.1, 0.2


def recorded(folder: Path, scenario: Scenario, silent: str = "") -> Recording:
    """A drift whose agent `silent` makes no step for a while."""
    records = [
        r
        for r in drift(scenario)
        if not (isinstance(r, Step) and r.agent == silent and SILENT_FROM < r.t < SILENT_UNTIL)
    ]
    return read(record(folder, scenario, records, summary_of(scenario)))


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    scenario = unicycles("network.loss=0.3", "network.delay=0.015")
    return recorded(tmp_path_factory.mktemp("lossy"), scenario, silent="2")


def lines(axes: Axes) -> dict[str, int]:
    """Count the broadcasts that are drawn, by fate."""
    drawn = [c for c in axes.collections if isinstance(c, LineCollection)]
    return {str(c.get_label()): len(c.get_segments()) for c in drawn}


def test_a_broadcast_is_late_if_its_receiver_stepped_before_it_came(lossy: Recording) -> None:
    table = broadcasts(lossy)
    fates = [fate for step in lossy.steps for fate in step.fates]
    assert len(table) > 0.9 * len(fates)  # the silent agent's own were never sent
    assert np.mean(table.fate == FATES.index(LOST)) == pytest.approx(0.3, rel=0.3)
    steps = {i: [s.t for s in lossy.steps if s.agent == str(i + 1)] for i in range(5)}
    for b in table:
        between = [t for t in steps[b.receiver] if b.sent < t < b.arrival]
        assert (FATES[b.fate] == LATE) == (FATES[b.fate] != LOST and len(between) > 0)


@pytest.mark.slow
def test_a_broadcast_is_sent_when_its_input_takes_effect() -> None:
    changes = {"duration": 0.2, "time.latency": 0.005, "network.delay": 0.004}
    recording = phalanx.run(phalanx.load("unicycles", changes), engine="in-process").recording
    step_times = {i: [s.t for s in recording.steps if s.agent == str(i + 1)] for i in range(5)}
    messages = broadcasts(recording)
    assert {FATES[b.fate] for b in messages} == {IN_TIME, LATE}
    for b in messages:
        assert any(t + 0.005 == b.sent for t in step_times[b.sender])
        between = [t for t in step_times[b.receiver] if b.sent < t < b.arrival]
        assert (FATES[b.fate] == LATE) == bool(between)


def test_the_zoom_draws_what_was_sent_in_its_window_and_no_more(lossy: Recording) -> None:
    figure = space_time(ReportHistory(lossy))
    assert figure is not None
    zoom = figure.axes[1]
    begin, end = zoom.get_xlim()
    worst = lossy.times[int(np.argmax(lossy.h_tot))]
    assert begin <= worst <= end + 1e-9
    assert end - begin == pytest.approx(0.08)
    inside = [b for b in broadcasts(lossy) if begin <= b.sent <= end]
    expected = {fate: sum(FATES[b.fate] == fate for b in inside) for fate in (IN_TIME, LATE, LOST)}
    assert lines(zoom) == expected


def test_an_agent_that_makes_no_step_for_longer_than_its_tau_is_silent(lossy: Recording) -> None:
    figure = space_time(ReportHistory(lossy))
    assert figure is not None
    (image,) = figure.axes[0].images
    pixels = np.asarray(image.get_array())
    silent = np.all(np.isclose(pixels, to_rgb("#475569")), axis=2)
    silent[:, silent.shape[1] // 2 :] = False  # no agent made a step in the last third
    assert list(np.flatnonzero(silent.any(axis=1))) == [4 * 1 + 2]
    times = np.flatnonzero(silent[6]) / silent.shape[1] * image.get_extent()[1]
    assert SILENT_FROM < times.min() < times.max() < SILENT_UNTIL


@pytest.mark.slow
def test_of_many_agents_the_zoom_shows_twelve_with_the_worst_pair(tmp_path: Path) -> None:
    scenario = swarm_in_space(16, 3, {"network": {"loss": 0.3}})
    recording = recorded(tmp_path, scenario)
    recording.summary.worst_pair = "n0-n15"
    figure = space_time(ReportHistory(recording))
    assert figure is not None
    whole, zoom = figure.axes
    labels = [text.get_text() for text in zoom.get_yticklabels()]
    assert len(labels) == 12
    assert {"n0", "n15"} <= set(labels)
    assert "7 more not drawn" in zoom.get_ylabel()
    assert len(whole.get_yticks()) == 19


def test_without_a_broadcast_there_is_no_diagram(tmp_path: Path) -> None:
    scenario = swarm_in_space(1, 2, {})
    assert space_time(ReportHistory(recorded(tmp_path, scenario))) is None


@pytest.mark.nightly
def test_every_control_step_has_a_dot() -> None:
    assert set().union(*(origins for *_, origins in _DOTS)) == set(Origin)


@pytest.mark.nightly
def test_link_statistics_are_those_of_the_links(recording: Recording, faulty: Scenario) -> None:
    statistics = link_statistics(recording)
    assert {(s.sender, s.receiver) for s in statistics} == {
        (a, b) for a in "123" for b in "123" if a != b
    }
    for link in statistics:
        truth = [fate(faulty, link.sender, link.receiver, k) for k in range(40)]
        delays = [delay for delay in truth if delay is not None]
        assert (link.broadcasts, link.decided) == (40, 40)
        assert link.lost == 40 - len(delays) > 0
        assert link.loss == link.lost / 40
        assert link.delays == delays
        assert link.model.loss == 0.3


def test_distances_are_those_of_the_output_points(recording: Recording) -> None:
    history = ReportHistory(recording)
    composed = history.swarm.safe_set
    h = ca.Function("h", [composed.x], [composed.h])
    for state in (0, 59):
        between = np.array(h(recording.x[state]))[:, 0]
        for pair, expected in zip(composed.pairs, between, strict=True):
            radius = 1.0 if pair.b < len(composed.members) else 1.25
            from_distance = radius**2 - history.distance(pair)[state] ** 2
            assert from_distance == pytest.approx(expected, rel=1e-9)


def test_steps_are_sorted_by_agent(recording: Recording) -> None:
    steps = steps_by_agent(recording)
    assert list(steps) == ["1", "2", "3", "4", "5"]
    assert [s.k for s in steps["3"]] == list(range(40))
