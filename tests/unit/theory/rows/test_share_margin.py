"""The margin of shares: the rate at which the joint condition tightens, and sums of shares."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.polytope import maximiser, minimiser
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.rows.composed import SwarmTerms
from phalanx.theory.rows.row import Terms, joint_sum, split_row, total_span
from phalanx.theory.rows.share_margin import ShareMargin
from phalanx.theory.safety.chain import Chain, build_chain
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.pairs import SwarmPairs
from tests.unit.theory.users_own import swarm_of
from tests.unit.theory.whole_expression import TermsFunction

NORMAL, BOUNDS, GAINS = (0, 1), (0.3, 0.0, 0.5), (1.3, 0.9)
seeds = st.integers(0, 2**32 - 1)
degrees = st.sampled_from([1, 2])


class Case:
    """Two normal agents and an adversary, of relative degree q."""

    def __init__(self, q: int) -> None:
        first = [Unicycle(4.0, 2.0), SingleIntegrator(1.5), Unicycle(2.0, 1.0)]
        second = [
            DoubleIntegrator(a, drag, dimension=2) for a, drag in [(2, 0), (1, 0.5), (1.5, 0)]
        ]
        composed = swarm_of(first if q == 1 else second).composed
        self.chain: Chain = build_chain(composed, GAINS[:q])
        self.terms = TermsFunction(self.chain)
        members, parts, x = composed.members, composed.parts, composed.x
        drift = [m.dynamics.drift(x[part]) for m, part in zip(members, parts, strict=True)]
        self.drift = ca.Function("f", [x], [ca.vertcat(*drift)])
        g = [m.dynamics.actuation(x[part]) for m, part in zip(members, parts, strict=True)]
        self.actuation = ca.Function("g", [x], [ca.diagcat(*g)])
        self.parts = parts

    def rate(self, x: np.ndarray, u: list[np.ndarray], phi: np.ndarray) -> np.ndarray:
        driven = np.array(self.actuation(x)) @ np.concatenate(u)
        return np.array(self.drift(x)).ravel() + driven + phi


@cache
def case(q: int) -> Case:
    return Case(q)


@cache
def share_margin(q: int, horizon: float, xi: float | None = 0.0) -> ShareMargin:
    """xi: as build_chain has it; the chain is the printed one where it is given."""
    composed, alphas = case(q).chain.set, [Linear(gain) for gain in GAINS[:q]]
    pairs = SwarmPairs(composed.members, composed.obstacles, composed.function, q)
    swarm = SwarmTerms(pairs, composed.rho, alphas, 0.0)
    return ShareMargin(swarm.by_derivatives(xi, BOUNDS, printed=xi is not None), horizon)


def drawn(seed: int, q: int) -> tuple[np.random.Generator, np.ndarray, float]:
    """A state, and the η with which a given part of the agents' range is left there."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.0, 2.0, case(q).chain.set.x.numel())
    terms = case(q).terms(x)
    return rng, x, -rng.uniform(0.1, 0.9) * total_span(terms, NORMAL) - joint_sum(terms, NORMAL)


def left(q: int, x: np.ndarray, eta: float) -> float:
    """r = -T / W."""
    terms = case(q).terms(x)
    return -(joint_sum(terms, NORMAL) + eta) / total_span(terms, NORMAL)


def slope_of_left(q: int, x: np.ndarray, eta: float) -> np.ndarray:
    """∂r/∂x by central differences."""
    steps = 1e-6 * np.eye(len(x))
    return np.array([(left(q, x + e, eta) - left(q, x - e, eta)) / 2e-6 for e in steps])


def worst_motion(
    q: int, x: np.ndarray, terms: Terms, slope: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """The inputs and disturbances with which r falls fastest."""
    forces = slope @ np.array(case(q).actuation(x))
    ends = np.cumsum([len(p.corners[0]) for p in terms.polytopes.values()])[:-1]
    u = [
        minimiser(force, p.corners)
        for force, p in zip(np.split(forces, ends), terms.polytopes.values(), strict=True)
    ]
    phi = np.zeros_like(x)
    for part, bound in zip(case(q).parts, BOUNDS, strict=True):
        phi[part] = -bound * slope[part] / max(float(np.linalg.norm(slope[part])), 1e-12)
    return u, phi


@pytest.mark.slow
@given(seed=seeds, q=degrees)
def test_it_is_the_fastest_fall_of_what_every_agent_may_use(seed, q):
    _, x, eta = drawn(seed, q)
    terms = case(q).terms(x)._replace(margin=eta)
    slope = slope_of_left(q, x, eta)
    fall = -slope @ case(q).rate(x, *worst_motion(q, x, terms, slope))
    margin = share_margin(q, 1.0)(x, terms, NORMAL)
    expected = total_span(terms, NORMAL) * max(0.0, fall)
    assert margin == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("q", [1, 2])
@pytest.mark.parametrize("xi", [0.0, None])
def test_it_is_that_of_the_whole_expression(q, xi):
    """Compare at 2000 states, for the printed chain and for one with all D_k."""
    whole = Whole(build_chain(case(q).chain.set, GAINS[:q], xi, None if xi == 0.0 else BOUNDS))
    for seed in range(1000):
        _, x, eta = drawn(seed, q)
        terms = case(q).terms(x)._replace(margin=eta)
        found, expected = share_margin(q, 1.0, xi)(x, terms, NORMAL), whole(x, terms)
        assert abs(found - expected) <= 1e-12 * max(1.0, expected)


class Whole:
    """The margin from one expression of all states."""

    def __init__(self, chain: Chain) -> None:
        composed = chain.set
        w = [ca.SX.sym("w", len(m.dynamics.inputs)) for m in composed.members]
        last = ca.sum1(chain.drift) + chain.alpha
        for c, u in zip(chain.actuation, w, strict=True):
            last += c @ u
        if chain.relative_degree > 1:
            last += chain.disturbance
        slopes = ca.jacobian(last, composed.x)
        unforced, forces = ca.SX(0), []
        for member, part, bound in zip(composed.members, composed.parts, BOUNDS, strict=True):
            x, slope = composed.x[part], slopes[:, part]
            unforced += slope @ member.dynamics.drift(x) + bound * ca.norm_2(slope)
            forces.append(slope @ member.dynamics.actuation(x))
        settled = [composed.substitute(o) for o in [unforced, *forces]]
        self._evaluate = CompiledFunction([composed.x, ca.vertcat(*w)], settled)

    def __call__(self, x: np.ndarray, terms: Terms) -> float:
        used = min(max(-joint_sum(terms, NORMAL) / total_span(terms, NORMAL), 0.0), 1.0)
        inputs = []
        for l, polytope in sorted(terms.polytopes.items()):
            best, worst = (f(terms.c[l], polytope.corners) for f in (minimiser, maximiser))
            inputs.append(worst + (1.0 - used if l in NORMAL else 0.0) * (best - worst))
        unforced, *forces = self._evaluate(x, np.concatenate(inputs))
        return max(
            0.0,
            float(unforced[0])
            + sum(
                float((terms.polytopes[l].corners @ force).max()) for l, force in enumerate(forces)
            ),
        )


HORIZON, STEPS = 1e-3, 10


def joint_sum_at_the_end(seed: int, q: int, keeps: bool) -> tuple[float, float]:
    """J when agents have sampled at different instants of a horizon, and their margins.

    Each uses just its share, in the direction of its worst to its best input. From the first
    instant on the adversary, the disturbances and agents without an input yet do their worst.
    """
    rng, x, eta = drawn(seed, q)
    margin = share_margin(q, HORIZON)
    terms = case(q).terms(x)._replace(margin=eta)
    u, phi = worst_motion(q, x, terms, slope_of_left(q, x, eta))
    samples = {i: int(rng.integers(STEPS)) for i in NORMAL}
    most = 0.0
    for step in range(STEPS + 1):
        terms = case(q).terms(x)._replace(margin=eta)
        for i in [i for i in NORMAL if samples[i] == step]:
            kept = margin(x, terms, NORMAL)
            row = split_row(terms, i, NORMAL, kept if keeps else 0.0)
            best, worst = (
                f(terms.c[i], terms.polytopes[i].corners) for f in (minimiser, maximiser)
            )
            used = (row.bound - terms.least[i]) / (terms.most[i] - terms.least[i])
            u[i], most = best + min(used, 1.0) * (worst - best), max(most, kept)
        if step < STEPS:
            x = x + HORIZON / STEPS * case(q).rate(x, u, phi)
    joint = terms.unforced + eta + float(terms.most[2]) + sum(terms.c[i] @ u[i] for i in NORMAL)
    return float(joint), most


@pytest.mark.slow
@given(seed=seeds, q=degrees)
@settings(max_examples=25)
def test_shares_from_different_samples_add_up_while_they_are_held(seed, q):
    joint, kept = joint_sum_at_the_end(seed, q, keeps=True)
    assume(kept > 1e-3)
    assert joint <= 0.03 * kept


@pytest.mark.parametrize("q", [1, 2])
def test_without_it_they_would_not(q):
    found = [joint_sum_at_the_end(seed, q, keeps=False) for seed in range(20)]
    assert max(joint / kept for joint, kept in found if kept > 1e-3) > 0.2


@pytest.mark.parametrize(
    ("overrides", "kept"),
    [
        (["safety.information=split"], True),
        (["safety.information=split", "safety.composition=pairs"], False),
        (["safety.information=split", "safety.control=centralised"], False),
        (["safety.information=paper"], False),
    ],
)
def test_agents_keep_it_back_where_they_share_one_condition(overrides, kept):
    rows = build_rows(build_swarm(load("one-on-one", overrides)))
    assert (rows.share_margin(rows.swarm.normal[0]) is not None) == kept
