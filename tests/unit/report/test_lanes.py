"""The space-time diagram: fates of broadcasts, and states of agents."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb

import phalanx
from phalanx.recording.broadcasts import IN_TIME, LATE, LOST, broadcasts
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import Recording, read
from phalanx.recording.records import Step
from phalanx.report.links import space_time
from phalanx.scenario.model import Scenario
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space, unicycles

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
    sent = list(broadcasts(lossy))
    fates = [fate for step in lossy.steps for fate in step.fates]
    assert len(sent) > 0.9 * len(fates)  # the silent agent's own were never sent
    assert sum(b.fate == LOST for b in sent) == pytest.approx(0.3 * len(sent), rel=0.3)
    steps = {i: [s.t for s in lossy.steps if s.agent == str(i + 1)] for i in range(5)}
    for b in sent:
        between = [t for t in steps[b.receiver] if b.sent < t < b.arrival]
        assert (b.fate == LATE) == (b.fate != LOST and len(between) > 0)


def test_a_broadcast_is_sent_when_its_input_takes_effect() -> None:
    changes = {"duration": 0.2, "time.latency": 0.005, "network.delay": 0.004}
    recording = phalanx.run(phalanx.load("unicycles", changes), engine="in-process").recording
    step_times = {i: [s.t for s in recording.steps if s.agent == str(i + 1)] for i in range(5)}
    sent = list(broadcasts(recording))
    assert {b.fate for b in sent} == {IN_TIME, LATE}
    for b in sent:
        assert any(t + 0.005 == b.sent for t in step_times[b.sender])
        assert (b.fate == LATE) == any(b.sent < t < b.arrival for t in step_times[b.receiver])


def test_the_zoom_draws_what_was_sent_in_its_window_and_no_more(lossy: Recording) -> None:
    figure = space_time(ReportHistory(lossy))
    assert figure is not None
    zoom = figure.axes[1]
    begin, end = zoom.get_xlim()
    worst = lossy.times[int(np.argmax(lossy.h_tot))]
    assert begin <= worst <= end + 1e-9
    assert end - begin == pytest.approx(0.08)
    inside = [b for b in broadcasts(lossy) if begin <= b.sent <= end]
    expected = {fate: sum(b.fate == fate for b in inside) for fate in (IN_TIME, LATE, LOST)}
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
    named = [text.get_text() for text in zoom.get_yticklabels()]
    assert len(named) == 12
    assert {"n0", "n15"} <= set(named)
    assert "7 more not drawn" in zoom.get_ylabel()
    assert len(whole.get_yticks()) == 19


def test_without_a_broadcast_there_is_no_diagram(tmp_path: Path) -> None:
    scenario = swarm_in_space(1, 2, {})
    assert space_time(ReportHistory(recorded(tmp_path, scenario))) is None
