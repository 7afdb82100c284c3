"""The margin used beside the margin needed, of real runs."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import phalanx
from phalanx.recording.read import Recording, read
from phalanx.report.margins import margin_use, margins
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.integrated import integrated_margin
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.safety.function import Body, Separation


class Folded(Separation):
    """A separation with an operation that has no interval rule."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return super().between(a, b) + 1e-9 * ca.fmod(b.p[0], 2.0)


def ran(folder: Path, name: str, *overrides: str) -> Recording:
    scenario = phalanx.load(name, ["duration=0.3", *overrides])
    return read(phalanx.run(scenario, engine="in-process", out=folder).folder)


def used_and_needed(recording: Recording, i: int):
    found = margin_use(recording, build_rows(build_swarm(recording.scenario)), i)
    assert found is not None
    return found


def test_a_bound_of_all_inputs_is_at_least_what_the_applied_one_needs(tmp_path):
    recording = ran(tmp_path, "guaranteed")
    for i in (0, 1, 2):
        found = used_and_needed(recording, i)
        assert not found.short.any()
        assert (found.needed < 0.999 * found.used).all()
    _, words = margins(recording, build_rows(build_swarm(recording.scenario)))
    assert "less than that at 0 of" in words


def test_a_margin_scaled_down_is_short(tmp_path):
    found = used_and_needed(ran(tmp_path, "guaranteed", "safety.margin_scale=0.5"), 0)
    assert found.short.all()


def test_of_a_given_margin_the_number_itself_was_used(tmp_path):
    recording = ran(tmp_path, "unicycles")
    found = used_and_needed(recording, 0)
    assert (found.used == 8.0566).all()
    figure, words = margins(recording, build_rows(build_swarm(recording.scenario)))
    assert [panel.get_yscale() for panel in figure.axes] == ["log"] * 3
    steps = sum(step.agent in ("1", "2", "3") for step in recording.steps)
    assert f"less than that at {steps} of {steps} steps." in words


def test_the_margin_needed_is_the_bound_of_the_pair_that_the_input_left_least(tmp_path):
    recording = ran(tmp_path, "unicycles")
    rows = build_rows(build_swarm(recording.scenario))
    swarm, step = rows.swarm, next(s for s in recording.steps if s.agent == "1")
    x, u = recording.x[0], ca.SX.sym("u", 2)
    left, needed = [], []
    for other in (1, 2, 3, 4):
        pair = rows.own_pair(0, other)
        chain, bounds = pair.chain, [swarm.disturbance_bounds[swarm.names[l]] for l in (0, other)]
        condition = chain.actuation[0] @ u + ca.sum1(chain.drift) + chain.alpha
        corners = ca.vertcat(*[ca.DM(c).T for c in rows.terms(other)(x).polytopes[other].corners])
        condition += ca.mmax(corners @ chain.actuation[1].T)
        bound = integrated_margin(chain, 0, swarm.horizon(0), bounds, RowPart.WHOLE, u)
        evaluate = CompiledFunction([chain.set.x, u], [condition, bound])
        of_pair = np.concatenate([x[swarm.safe_set.parts[l]] for l in (0, other)])
        found = evaluate(of_pair, np.array(step.u))
        left.append(float(found[0][0]))
        needed.append(float(found[1][0]))
    expected = needed[int(np.argmax(left))]
    assert used_and_needed(recording, 0).needed[0] == pytest.approx(expected, rel=1e-9)


def test_many_agents_are_summarised_as_shares_of_what_is_needed(tmp_path):
    recording = ran(tmp_path, "swarm2d", "duration=0.2")
    figure, _ = margins(recording, build_rows(build_swarm(recording.scenario)))
    (axes,) = figure.axes
    assert axes.get_ylabel() == "margin used / needed"


def test_where_nothing_can_be_bounded_the_figure_says_why(tmp_path):
    recording = ran(tmp_path, "unicycles", f"safety.function.type='{__name__}:Folded'")
    _, words = margins(recording, build_rows(build_swarm(recording.scenario)))
    assert "no interval rule for the operation fmod" in words


def test_a_recording_without_steps_has_no_such_figure(tmp_path):
    recording = replace(ran(tmp_path, "unicycles"), steps=[])
    assert margins(recording, build_rows(build_swarm(recording.scenario))) is None
