"""The margin used and the margin needed, of real runs."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

import phalanx
from phalanx.curves.history import ReportHistory
from phalanx.curves.values import SafetyValues
from phalanx.recording.read import Recording, read
from phalanx.report.margins import MarginUse, margin_use, margins
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.integrated import RowPart, integrated_margin
from phalanx.theory.safety.function import Body, Separation


class Folded(Separation):
    """A separation with an operation that has no interval rule."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return super().between(a, b) + 1e-9 * ca.fmod(b.p[0], 2.0)


class Ran(NamedTuple):
    """A run and the rows that made it, whose margins are compiled once."""

    recording: Recording
    rows: SafetyRows

    @property
    def history(self) -> ReportHistory:
        return ReportHistory(self.recording, SafetyValues(self.rows))

    def used_and_needed(self, i: int) -> MarginUse:
        found = margin_use(self.history, i)
        assert found is not None
        return found


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Ran]:
    """A scenario's run, each made once for all tests."""

    @cache
    def run(name: str, *overrides: str) -> Ran:
        scenario = phalanx.load(name, ["duration=0.1", *overrides])
        folder = phalanx.run(
            scenario, engine="in-process", out=tmp_path_factory.mktemp(name)
        ).folder
        return Ran(read(folder), build_rows(build_swarm(scenario)))

    return run


@pytest.mark.slow
def test_a_bound_of_all_inputs_is_at_least_what_the_applied_one_needs(ran):
    run = ran("guaranteed")
    for i in (0, 1, 2):
        found = run.used_and_needed(i)
        assert not found.short.any()
        assert (found.needed < 0.999 * found.used).all()
    _, words = margins(run.history)
    assert "less than that at 0 of" in words


@pytest.mark.slow
def test_a_margin_scaled_down_is_short(ran):
    assert ran("guaranteed", "safety.margin_scale=0.5").used_and_needed(0).short.all()


@pytest.mark.slow
def test_of_a_given_margin_the_number_itself_was_used(ran):
    run = ran("unicycles")
    assert (run.used_and_needed(0).used == 8.0566).all()
    figure, words = margins(run.history)
    assert [panel.get_yscale() for panel in figure.axes] == ["log"] * 3
    steps = sum(step.agent in ("1", "2", "3") for step in run.recording.steps)
    assert f"less than that at {steps} of {steps} steps." in words


@pytest.mark.parametrize("name", ["guaranteed", "unicycles"])
def test_the_margin_that_an_agent_reports_is_the_one_its_row_used(ran, name):
    run = ran(name)
    reported = [step.margin for step in run.recording.steps if step.agent == "1"]
    assert reported == pytest.approx(run.used_and_needed(0).used.tolist(), rel=1e-12)
    assert {step.margin for step in run.recording.steps if step.agent == "4"} == {None}


def test_the_margin_needed_is_the_bound_of_the_pair_that_the_input_left_least(ran):
    run = ran("unicycles")
    recording, rows = run
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
    assert run.used_and_needed(0).needed[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_many_agents_are_summarised_as_shares_of_what_is_needed(ran):
    figure, _ = margins(ran("swarm2d").history)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "margin used / needed"


@pytest.mark.slow
def test_where_nothing_can_be_bounded_the_figure_says_why(ran):
    _, words = margins(ran("unicycles", f"safety.function.type='{__name__}:Folded'").history)
    assert "no interval rule for the operation fmod" in words


def test_a_recording_without_steps_has_no_such_figure(ran):
    recording, rows = ran("unicycles")
    assert margins(Ran(replace(recording, steps=[]), rows).history) is None
