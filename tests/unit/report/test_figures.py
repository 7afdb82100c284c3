"""The figures of inputs: their marks, bounds and norm."""

import dataclasses

import msgspec
import numpy as np
import pytest

from phalanx.recording.read import Recording
from phalanx.report import figures
from phalanx.report.measures import origins
from phalanx.swarm.swarm import build_swarm
from tests.unit.swarms import swarm_of_scenario


def test_a_mark_stands_at_every_step_with_an_empty_set(recording: Recording) -> None:
    swarm = build_swarm(recording.scenario)
    panels = figures.inputs(recording, swarm, 0).axes
    assert len(panels) == 2
    for axes in panels:
        marks = {c.get_label(): c.get_offsets()[:, 0] for c in axes.collections}
        assert list(marks["backup (4 steps)"]) == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert list(marks["no-authority (4 steps)"]) == pytest.approx([0.05, 0.15, 0.25, 0.35])
    assert origins(recording) == {"qp": 96, "solver-failed": 0, "backup": 12, "no-authority": 12}


def test_inputs_are_drawn_between_the_bounds_of_their_polytope(recording: Recording) -> None:
    speed, turn_rate = figures.inputs(recording, build_swarm(recording.scenario), 4).axes
    for axes, bound in ((speed, 2.0), (turn_rate, 1.0)):
        dotted = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]
        assert sorted(dotted) == pytest.approx([-bound, bound])


def test_certified_times_are_drawn_in_multiples_of_tau_with_a_mark_below_one(
    recording: Recording,
) -> None:
    figure = figures.certified(recording, build_swarm(recording.scenario))
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


def test_a_recording_without_certified_times_has_no_figure_of_them(recording: Recording) -> None:
    steps = [msgspec.structs.replace(step, certified=None) for step in recording.steps]
    bare = dataclasses.replace(recording, steps=steps)
    assert figures.certified(bare, build_swarm(recording.scenario)) is None


def test_where_the_inputs_lie_in_a_cube_their_infinity_norm_is_drawn_first() -> None:
    u = np.array([[0.5, -1.5, 1.0], [0.0, 0.2, -0.1]])
    norm, *components = figures.input_curves(swarm_of_scenario("formation3d"), 0, u)
    assert norm.label == "‖u‖∞ [SI]"
    assert list(norm.values) == [1.5, 0.2]
    assert norm.bounds == (2.0,)
    assert len(components) == 3
    assert len(figures.input_curves(swarm_of_scenario("unicycles"), 0, u[:, :2])) == 2
