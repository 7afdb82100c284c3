"""Pairs, their composition by LSE, and its ψ-chain from the numbers of pairs."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import Member, Pair, compose, log_sum_exp
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.obstacles import Sphere
from tests.unit.theory.users_own import Oval, swarm_of

POINT = SingleIntegrator(1.0)
values = st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=12)


def lse(h: list[float], rho: float, sigma: float) -> float:
    h_, s = ca.SX.sym("h", len(h)), ca.SX.sym("s")
    return float(CompiledFunction([h_, s], [log_sum_exp(h_, rho, s)])(np.array(h), sigma)[0][0])


@given(values, st.floats(0.05, 50.0), st.floats(-5.0, 5.0))
def test_lse_is_at_most_ln_p_over_rho_above_the_largest_h_whatever_sigma_is(h, rho, shift):
    h_tot = lse(h, rho, max(h))
    assert max(h) <= h_tot <= max(h) + np.log(len(h)) / rho + 1e-9 * (1 + abs(max(h)))
    assert lse(h, rho, max(h) + shift) == pytest.approx(h_tot, abs=1e-9, rel=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(0.05, 50.0))
def test_equal_h_give_the_upper_end_of_the_bracket(h, rho):
    assert lse([h] * 7, rho, h) == pytest.approx(h + np.log(7) / rho, rel=1e-12)


@pytest.mark.parametrize("far", [1e3, 1e5])
def test_the_composed_set_chooses_sigma_so_that_nothing_overflows_or_vanishes(far):
    """σ matters: with σ = 0, exp(-ρ d²) is 0 for distant agents and ln 0 is -∞."""
    case = swarm_of([POINT, POINT, POINT], rho=5.0)
    h_tot = CompiledFunction([case.composed.x], [case.composed.substitute(case.composed.h_tot)])
    x = far * np.array([1.0, 0.0, -1.0, 0.5, 0.0, -1.0])
    assert h_tot(x)[0][0] == pytest.approx(case.twin.h_tot(x), rel=1e-12)


def test_pairs_are_normal_normal_normal_adversary_and_normal_obstacle_and_no_others():
    members = [
        Member("n1", POINT, False),
        Member("a1", POINT, True),
        Member("n2", POINT, False),
        Member("a2", POINT, True),
    ]
    obstacles = [Sphere((9.0, 0.0), 1.0), Sphere((0.0, 9.0), 1.0)]
    composed = compose(members, obstacles, Separation(1.0), 1.0)
    expected = {
        Pair(0, 2),
        *(Pair(i, j) for i in (0, 2) for j in (1, 3)),
        *(Pair(i, 4 + k) for i in (0, 2) for k in (0, 1)),
    }
    assert set(composed.pairs) == expected
    assert len(composed.pairs) == len(expected)
    labels = [composed.label(pair) for pair in composed.pairs]
    assert {"n1-n2", "n1-a1", "n2-obstacle 1"} <= set(labels)


@pytest.mark.parametrize("function", [Separation(1.3), Oval()])
def test_every_h_is_the_pairs_own_function_of_output_points(function, rng):
    case = swarm_of([Unicycle(1.0, 1.0)] * 3, function=function)
    h = CompiledFunction([case.composed.x], [case.composed.h])
    for x in rng.uniform(-6, 6, (30, 9)):
        assert h(x)[0] == pytest.approx(case.twin.h(x), abs=1e-10)


@pytest.mark.parametrize(
    ("adversary", "line"), [(True, "at least one normal agent"), (False, "one agent alone")]
)
def test_adversaries_only_and_one_agent_without_obstacle_are_refused(adversary, line):
    with pytest.raises(ValueError, match=line):
        compose([Member("a", POINT, adversary)], [], Separation(1.0), 1.0)


@pytest.mark.parametrize("q", [1, 2, 3])
def test_psi_at_several_states_is_what_each_has_alone_and_pairs_without_weight_change_no_digit(q):
    rho = 0.05
    jets = LogSumExpJets(rho, [Linear(0.4)] * q, 39.0)
    rng = np.random.default_rng(q)
    for states, pairs in ((1, 1), (5, 3), (16, 62), (2, 62), (3, 17)):
        h = rng.normal(size=(states, pairs, q + 1)) * [100.0, *[10.0] * q]
        weights = np.exp(rho * (h[..., 0] - h[..., 0].max(axis=1, keepdims=True)))
        h_tot = h[..., 0].max(axis=1) + np.log(weights.sum(axis=1)) / rho
        w = weights / weights.sum(axis=1, keepdims=True)
        psi = jets.psi(h_tot, w, h[..., :q])
        alone = np.stack([jets(one).psi for one in h])
        assert psi == pytest.approx(alone, rel=1e-11, abs=1e-11)
        w[:, pairs // 2] = 0.0
        without = np.delete(w, pairs // 2, axis=1), np.delete(h[..., :q], pairs // 2, axis=1)
        if pairs > 1:
            assert (jets.psi(h_tot, w, h[..., :q]) == jets.psi(h_tot, *without)).all()


@pytest.mark.parametrize("q", [1, 2, 3])
def test_weights_are_the_slopes_of_the_last_psi_by_each_pairs_derivatives(q):
    """Compare with central differences; from q = 3 on the product rule counts terms twice."""
    rng = np.random.default_rng(q)
    jets = LogSumExpJets(0.7, [Linear(0.4 + 0.2 * k) for k in range(q)], 0.5)
    h, step = rng.normal(size=(4, q + 1)), 1e-5
    weights = jets(h).weights.copy()
    for p in range(4):
        for j in range(q):
            moved = np.zeros_like(h)
            moved[p, j] = step
            slope = (jets(h + moved).psi[-1] - jets(h - moved).psi[-1]) / (2.0 * step)
            assert weights[p, j] == pytest.approx(slope, rel=1e-6, abs=1e-8)
