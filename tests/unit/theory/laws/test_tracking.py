"""Nominal laws and attacks of agents whose inputs are velocities or accelerations."""

from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.laws.attacks import Script, WorstCase
from phalanx.theory.laws.goals import Goal, hold
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import OutputVelocity, Pursue, TrackVelocity, output_chain
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import build_chain
from tests.unit.swarms import rows_of_scenario
from tests.unit.theory.users_own import Case, Drifter, OutputUnicycle, along, swarm_of
from tests.unit.theory.whole_expression import TermsFunction

seeds = st.integers(0, 2**32 - 1)
NORMAL = (0, 1, 2)


@cache
def fleet() -> Case:
    return swarm_of([Unicycle(4.0, 2.0)] * 2 + [SingleIntegrator(1.0)] + [Unicycle(2.0, 1.0)])


@cache
def terms_function() -> TermsFunction:
    return TermsFunction(build_chain(fleet().composed, [1.0]))


def view(x: np.ndarray, i: int, goal: Goal) -> View:
    states = {l: x[part] for l, part in enumerate(fleet().composed.parts)}
    return View(i, states, NORMAL, goal, terms_function()(x), 0.0)


def output_velocity(x: np.ndarray, i: int, u: np.ndarray) -> np.ndarray:
    """dp_i/dt under u, by finite differences of the numpy twin."""
    twin = fleet().twin
    rate = twin.f(i, x) + twin.g(i, x) @ u
    axes = range(len(twin.position(i, x)))
    return np.array([along(lambda y, a=a: twin.position(i, y)[a], x, rate) for a in axes])


@pytest.mark.parametrize(
    "dynamics", [Unicycle(1.0, 1.0, 0.3), OutputUnicycle(), Drifter(), SingleIntegrator(1.0, 3)]
)
@given(seed=seeds)
@settings(max_examples=20)
def test_output_velocity_inverts_the_dynamics(dynamics, seed):
    """J (f + g u) = v, the left side by finite differences."""
    rng = np.random.default_rng(seed)
    case = swarm_of([dynamics, dynamics], obstacles=())
    n = len(dynamics.states)
    x = rng.uniform(-2, 2, 2 * n)
    v = rng.uniform(-3, 3, len(case.twin.position(0, x)))
    if isinstance(dynamics, Drifter) and abs(np.linalg.det(case.twin.g(0, x)[:2])) < 0.1:
        return
    output, desired = OutputVelocity(dynamics), ca.SX.sym("v", len(v))
    (u,) = CompiledFunction([output.x, desired], [output.input_for(desired)])(x[:n], v)
    rate = case.twin.f(0, x) + case.twin.g(0, x) @ u
    moved = [along(lambda y, a=a: case.twin.position(0, y)[a], x, rate) for a in range(len(v))]
    assert moved == pytest.approx(v, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("dynamics", [DoubleIntegrator(3.0, 0.7, 2), TripleIntegrator(1.0)])
def test_dynamics_whose_inputs_do_not_act_on_the_velocity_are_refused_by_name(dynamics):
    with pytest.raises(ValueError, match=f"{type(dynamics).__name__}: expected as many inputs"):
        OutputVelocity(dynamics)


@given(seed=seeds)
@settings(max_examples=20)
def test_tracking_gives_the_output_the_goals_velocity_and_pulls_it_in(seed):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-3, 3, 11)
    for i in NORMAL:
        goal = Goal(rng.uniform(-5, 5, 2), rng.uniform(-1, 1, 2), np.zeros(2))
        law = TrackVelocity(gain=1.5)
        law.prepare(fleet().composed.members[i].dynamics)
        u = law.input(view(x, i, goal))
        desired = goal.velocity + 1.5 * (goal.position - fleet().twin.position(i, x))
        assert output_velocity(x, i, u) == pytest.approx(desired, rel=1e-5, abs=1e-5)


@given(seed=seeds)
@settings(max_examples=20)
def test_a_pursuer_heads_for_the_nearest_normal_agent(seed):
    x = np.random.default_rng(seed).uniform(-6, 6, 11)
    law = Pursue(gain=5.0)
    law.prepare(fleet().composed.members[3].dynamics)
    u = law.input(view(x, 3, hold(np.zeros(2))))
    here = fleet().twin.position(3, x)
    gaps = [fleet().twin.position(n, x) - here for n in NORMAL]
    nearest = min(gaps, key=np.linalg.norm)
    assert output_velocity(x, 3, u) == pytest.approx(5.0 * nearest, rel=1e-5, abs=1e-5)


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=40)
def test_no_input_in_the_polytope_pushes_harder_than_the_worst_case(seed):
    x = np.random.default_rng(seed).uniform(-3, 3, 11)
    u = WorstCase().input(view(x, 3, hold(np.zeros(2))))
    rows = terms_function()(x).polytopes[3]
    assert (rows.A @ u <= rows.b + 1e-9).all()

    def push(u: np.ndarray) -> float:
        return along(fleet().twin.h_tot, x, fleet().twin.g(3, x) @ u)

    assert push(u) >= max(push(corner) for corner in rows.corners) - 1e-6


def test_tracking_gives_the_output_the_desired_acceleration_but_for_drag():
    law = rows_of_scenario("formation3d").swarm.law(0)
    chain = output_chain(DoubleIntegrator(2.0, 0.5, 3))
    assert law.gains == (2.0, 2.8284271247461903)
    x, u_nom = np.arange(6.0), np.array([0.3, -0.2, 1.0])
    evaluate = CompiledFunction([chain.x], [ca.vertcat(*chain.derivatives[:-1])])
    assert evaluate(x)[0] == pytest.approx(x)
    assert np.array(ca.DM(chain.input_for(ca.SX(u_nom)))).ravel() == pytest.approx(u_nom)
    assert output_chain(Unicycle(1.0, 1.0)).degree == 1
    assert output_chain(SingleIntegrator(1.0)).degree == 1


def test_a_chasing_adversary_avoids_another_adversary_in_its_way():
    """Adversary 4 chases agent 0 straight through adversary 5."""
    swarm = rows_of_scenario("formation3d").swarm
    x = swarm.start()
    parts = swarm.safe_set.parts
    x[parts[0]] = [60.0, 0, 0, 0, 0, 0]
    x[parts[4]] = [50.0, 0, 0, 2.0, 0, 0]
    x[parts[5]] = [53.0, 0, 0, 0, 0, 0]
    terms, law = rows_of_scenario("formation3d").terms(4)(x), swarm.law(4)
    states = {l: x[part] for l, part in enumerate(parts)}
    sight = View(4, states, swarm.normal, hold(terms.positions[4]), terms, 0.0)
    assert law.input(sight)[0] < 0
    law.team = None
    assert law.input(sight)[0] > 0


gaps = st.lists(st.floats(1e-3, 10.0), max_size=6)


def at(t: float) -> View:
    """A view at a time: a script looks at nothing else."""
    return cast(View, cast(Any, SimpleNamespace(t=t)))


@given(gaps=gaps, t=st.floats(0.0, 60.0))
def test_the_last_input_that_has_begun_is_in_force(gaps, t):
    instants = tuple(np.cumsum([0.0, *gaps]).tolist())
    script = Script(instants, tuple((float(k), 0.0) for k in range(len(instants))))
    script.prepare(SingleIntegrator(10.0))
    begun = [k for k, instant in enumerate(instants) if instant <= t]
    assert script.input(at(t)).tolist() == [float(begun[-1]), 0.0]


def test_an_input_begins_at_its_instant():
    script = Script((0.0, 0.5), ((2.0, 1.0), (-2.0, 0.0)))
    script.prepare(Unicycle(2.0, 1.0))
    assert script.input(at(0.49)).tolist() == [2.0, 1.0]
    assert script.input(at(0.5)).tolist() == [-2.0, 0.0]


@pytest.mark.parametrize(
    ("instants", "inputs", "message"),
    [
        ((0.0, 1.0), ((0.0, 0.0),), "an input for each instant of at: 2, got 1"),
        ((0.5,), ((0.0, 0.0),), "expected at to begin with 0, got 0.5"),
        ((0.0, 1.0, 1.0), ((0.0, 0.0),) * 3, "expected at to ascend, got 1 after 1"),
        ((0.0,), ((2.0, 1.5),), r"inputs.0: .*nu, omega.* within U, \[-2, 2\] x \[-1, 1\], got"),
        ((0.0,), ((2.0,),), r"inputs.0: expected 2 numbers \(nu, omega\), got 1"),
    ],
)
def test_a_mistake_is_refused_with_its_place(instants, inputs, message):
    with pytest.raises(ValueError, match=message):
        Script(instants, inputs).prepare(Unicycle(2.0, 1.0))
