"""One look at a run: panels on new axes or on given ones."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import phalanx
from phalanx.report.plot import PANELS
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space, unicycles


@pytest.fixture
def run(tmp_path: Path) -> phalanx.Run:
    scenario = unicycles()
    return phalanx.open(record(tmp_path, scenario, drift(scenario), summary_of(scenario)))


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.mark.slow
def test_all_panels_are_drawn_on_a_figure_that_pyplot_shows(run: phalanx.Run):
    axes = run.plot()
    assert list(axes) == list(PANELS)
    assert {each.figure for each in axes.values()} == {plt.gcf()}
    assert all(each.lines for each in axes.values())
    assert axes["h"].get_title(loc="right") == "worst h 0.25 at 0.300 s"
    points = axes["h"].lines[0].get_xydata().tolist()
    assert points == run.states.select("t", "h_tot").to_numpy().tolist()


@pytest.mark.slow
def test_two_runs_on_the_same_axes(run: phalanx.Run):
    _, (left, right) = plt.subplots(1, 2)
    before = plt.get_fignums()
    assert run.plot(axes={"h": left, "paths": right}) == {"h": left, "paths": right}
    count = len(left.lines)
    run.plot("h", axes={"h": left})
    assert len(left.lines) == 2 * count
    assert plt.get_fignums() == before


@pytest.mark.slow
def test_a_swarm_in_space_is_seen_from_above(tmp_path: Path):
    scenario = swarm_in_space(13, 1, {})
    folder = record(tmp_path, scenario, drift(scenario, steps=3), summary_of(scenario))
    axes = phalanx.open(folder).plot()
    assert axes["paths"].get_ylabel() == "y [m]"
    assert [line.get_label() for line in axes["h"].lines][:2] == [
        "$h_{tot}$",
        "largest h of a pair",
    ]


@pytest.mark.slow
def test_what_cannot_be_drawn_is_refused_in_a_line(run: phalanx.Run, tmp_path: Path):
    for call, message in (
        (lambda: run.plot("speed"), "panel: expected paths, h, inputs, certified, got 'speed'"),
        (lambda: run.plot("h", axes={}), "axes: expected some for each panel, got none for 'h'"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            call()
    (tmp_path / "empty").mkdir()
    empty = phalanx.open(record(tmp_path / "empty", unicycles(), [], None))
    with pytest.raises(ValueError, match="the recording holds no state: nothing to draw"):
        empty.plot()
