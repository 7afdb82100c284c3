"""The figures of inputs: their marks, bounds and norm; and what figures keep in memory."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.curves.values import SafetyValues
from phalanx.recording.read import Recording
from phalanx.recording.records import State, Step
from phalanx.report import safety, steps
from phalanx.report.write import draw_figures, origins
from phalanx.scenario.load import load, read_table
from tests.unit.report.recordings import drift
from tests.unit.swarms import rows_of_scenario

pytestmark = pytest.mark.nightly


def test_a_mark_stands_at_every_step_with_an_empty_set(recording: Recording) -> None:
    panels = steps.inputs(ReportHistory(recording), 0).axes
    assert len(panels) == 2
    for axes in panels:
        marks = {c.get_label(): c.get_offsets()[:, 0] for c in axes.collections}
        assert list(marks["backup (4 steps)"]) == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert list(marks["no authority (4 steps)"]) == pytest.approx([0.05, 0.15, 0.25, 0.35])
    assert origins(recording) == {"qp": 96, "solver-failed": 0, "backup": 12, "no-authority": 12}


def test_one_agent_within_limits_has_no_distances_to_draw() -> None:
    fence = [{"type": "fence", "center": [0.0, 0.0], "radius": 8.0}]
    table = {**read_table("one-on-one"), "limits": fence}
    table["agents"] = table["agents"][:1]
    scenario = load(table)
    recording = Recording(Path(), scenario, {}, drift(scenario, states=2, steps=0), [])
    names = [figure.name for figure in draw_figures(ReportHistory(recording), [])]
    assert names == ["h_tot", "paths"]


def test_inputs_are_drawn_between_the_bounds_of_their_polytope(recording: Recording) -> None:
    speed, turn_rate = steps.inputs(ReportHistory(recording), 4).axes
    for axes, bound in ((speed, 2.0), (turn_rate, 1.0)):
        dotted = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]
        assert sorted(dotted) == pytest.approx([-bound, bound])


def test_certified_times_are_drawn_in_multiples_of_tau_with_a_mark_below_one(
    recording: Recording,
) -> None:
    figure = steps.certified(ReportHistory(recording))
    assert figure is not None
    (axes,) = figure.axes
    assert axes.get_yscale() == "log"
    *curves, one = axes.lines
    assert list(one.get_ydata()) == [1.0, 1.0]
    assert [c.get_label() for c in curves] == [f"{n}: shortest 0 τ" for n in "123"]
    for name, curve, below in zip("123", curves, axes.collections, strict=True):
        assert list(curve.get_ydata()[:5]) == pytest.approx([0.1, 0.5, 1.0, 1.5, 2.0])
        assert below.get_label() == f"{name}: below τ (8 of 40)"
        assert list(below.get_offsets()[:4, 0]) == pytest.approx([0.0, 0.01, 0.1, 0.11])


def test_where_the_inputs_lie_in_a_cube_their_infinity_norm_is_drawn_first() -> None:
    scenario = load("formation3d", ["duration=0.1"])
    records = drift(scenario, states=2, steps=2)
    states = [r for r in records if isinstance(r, State)]
    inputs = [(0.5, -1.5, 1.0), (0.0, 0.2, -0.1)]
    step_records = [
        msgspec.structs.replace(r, u=inputs[r.k]) for r in records if isinstance(r, Step)
    ]
    recording = Recording(Path(), scenario, {}, states, step_records)
    norm, *components = steps.inputs(ReportHistory(recording), 0).axes
    assert norm.get_ylabel() == "‖u‖∞ [m/s²]"
    assert [list(norm.lines[0].get_ydata()[:2]), len(components)] == [[1.5, 0.2], 3]
    bound = [line.get_ydata()[0] for line in norm.lines if line.get_linestyle() == ":"]
    assert bound == [2.0]


def test_psi_1_of_a_pair_that_closes_in_is_drawn_at_each_state() -> None:
    rows = rows_of_scenario("disturbance-gap")
    swarm, x = rows.swarm, rows.swarm.start()
    states = [State(0.1 * k, (x + 0.1 * k).tolist(), -1.0) for k in range(5)]
    recording = Recording(Path(), swarm.scenario, {}, states=states)
    figure = safety.psi(ReportHistory(recording, SafetyValues(rows)))
    assert figure is not None
    (axes,) = figure.axes
    expected = [rows.invariants()(np.array(s.x)).reshape(-1, 2)[:, 1].max() for s in states]
    assert list(axes.lines[0].get_ydata()) == pytest.approx(expected)
    assert not axes.get_title(loc="right"), "the largest of all steps may be another"
