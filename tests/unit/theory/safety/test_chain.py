"""ψ-chains of the built-in dynamics, against hand formulas (q <= 2) and Taylor series (q = 3)."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import KinematicBicycle, Unicycle
from phalanx.theory.safety.chain import RelativeDegreeError, build_chain
from phalanx.theory.safety.class_k import Power
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.theory.whole_expression import TermsFunction

R, RHO, XI = 1.3, 0.7, 2.5
A1, A2, A3 = 0.8, 1.7, 1.1
seeds = st.integers(0, 2**32 - 1)
close = {"rel": 1e-8, "abs": 1e-10}


def pair_of(dynamics, obstacles=(), count=2):
    members = [Member(f"a{i}", dynamics, i == 1) for i in range(count)]
    return compose(members, obstacles, Separation(R), RHO)


def state(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, n)


@cache
def terms_of(dynamics: Dynamics, *alphas: float | Power) -> TermsFunction:
    """Terms of a pair of such agents, with these gains."""
    return TermsFunction(build_chain(pair_of(dynamics), alphas, XI))


@given(seed=seeds)
def test_single_integrators_in_space_are_the_hand_formula(seed):
    x = state(6, seed)
    d = x[:3] - x[3:]
    terms = terms_of(SingleIntegrator(1.0, dimension=3), A1)(x)
    assert terms.psi == pytest.approx([R**2 - d @ d], **close)
    assert terms.unforced == pytest.approx(A1 * (R**2 - d @ d), **close)
    assert terms.c[0] == pytest.approx(-2 * d, **close)
    assert terms.c[1] == pytest.approx(2 * d, **close)


B = 0.25


@given(seed=seeds)
def test_unicycles_are_the_hand_formula(seed):
    x = state(6, seed)
    heads = [np.array([np.cos(t), np.sin(t)]) for t in (x[2], x[5])]
    lefts = [np.array([-np.sin(t), np.cos(t)]) for t in (x[2], x[5])]
    d = x[:2] + B * heads[0] - x[3:5] - B * heads[1]
    terms = terms_of(Unicycle(4.0, 2.0, B), A1)(x)
    assert terms.unforced == pytest.approx(A1 * (R**2 - d @ d), **close)
    assert terms.c[0] == pytest.approx([-2 * d @ heads[0], -2 * B * d @ lefts[0]], **close)
    assert terms.c[1] == pytest.approx([2 * d @ heads[1], 2 * B * d @ lefts[1]], **close)


BETA = 2 / 3


@pytest.mark.parametrize("n", [2, 3])
@given(seed=seeds)
def test_double_integrators_with_drag_are_the_hand_formula(n, seed):
    x = state(4 * n, seed)
    d, v = x[:n] - x[2 * n : 3 * n], x[n : 2 * n] - x[3 * n :]
    h = R**2 - d @ d
    psi_1 = -2 * d @ v + XI + A1 * h
    terms = terms_of(DoubleIntegrator(2.0, BETA, n), A1, A2)(x)
    assert terms.psi == pytest.approx([h, psi_1], **close)
    unforced = -2 * v @ v + 2 * BETA * d @ v - 2 * A1 * d @ v + A2 * psi_1
    assert terms.unforced == pytest.approx(unforced, **close)
    assert terms.c[0] == pytest.approx(-2 * d, **close)
    assert terms.c[1] == pytest.approx(2 * d, **close)


LENGTH = 0.4


@given(seed=seeds)
def test_bicycles_are_the_hand_formula(seed):
    x = state(8, seed)
    heads = [np.array([np.cos(t), np.sin(t)]) for t in (x[2], x[6])]
    lefts = [np.array([-np.sin(t), np.cos(t)]) for t in (x[2], x[6])]
    d, v = x[:2] - x[4:6], x[3] * heads[0] - x[7] * heads[1]
    h = R**2 - d @ d
    psi_1 = -2 * d @ v + XI + A1 * h
    terms = terms_of(KinematicBicycle(1.0, 1.0, LENGTH), A1, A2)(x)
    assert terms.psi == pytest.approx([h, psi_1], **close)
    assert terms.unforced == pytest.approx(-2 * v @ v - 2 * A1 * d @ v + A2 * psi_1, **close)
    for l, sign in ((0, -2), (1, 2)):
        across = x[4 * l + 3] ** 2 / LENGTH * lefts[l]
        assert terms.c[l] == pytest.approx([sign * d @ heads[l], sign * d @ across], **close)


class Series:
    """A Taylor polynomial in t, truncated after t³: a second automatic differentiation."""

    def __init__(self, coefficients):
        self.c = np.asarray(coefficients, dtype=float)

    def __add__(self, other):
        return Series(self.c + lift(other).c)

    def __mul__(self, other):
        return Series(np.convolve(self.c, lift(other).c)[:4])

    def derivative(self):
        return Series([*(self.c[1:] * [1, 2, 3]), 0.0])

    def exp(self):
        y = [np.exp(self.c[0])]
        for n in (1, 2, 3):
            y.append(sum(k * self.c[k] * y[n - k] for k in range(1, n + 1)) / n)
        return Series(y)

    def log(self):
        y = [np.log(self.c[0])]
        for n in (1, 2, 3):
            known = sum(k * y[k] * self.c[n - k] for k in range(1, n))
            y.append((self.c[n] - known / n) / self.c[0])
        return Series(y)


def lift(value):
    return value if isinstance(value, Series) else Series([value, 0, 0, 0])


@pytest.fixture(scope="module")
def triples() -> TermsFunction:
    composed = pair_of(TripleIntegrator(1.0, 3), [Sphere((0.5, 0.1, -0.3), 0.8)], count=3)
    return TermsFunction(build_chain(composed, [A1, A2, A3], XI))


def psi_by_series(x: np.ndarray, u: np.ndarray) -> list[float]:
    """ψ_0 ... ψ_3 along p + v t + a t²/2 + u t³/6 of three agents; the second is an adversary."""
    tracks = [
        [Series([b[c], b[3 + c], b[6 + c] / 2, w[c] / 6]) for c in range(3)]
        for b, w in zip(x.reshape(3, 9), u.reshape(3, 3), strict=True)
    ]

    def h(a, b, radius):
        distance = [p + q * -1.0 for p, q in zip(a, b, strict=True)]
        return lift(radius**2) + sum((d * d for d in distance), lift(0.0)) * -1.0

    center = [lift(c) for c in (0.5, 0.1, -0.3)]
    pairs = [h(tracks[0], tracks[2], R), h(tracks[0], tracks[1], R), h(tracks[2], tracks[1], R)]
    pairs += [h(tracks[0], center, 0.8), h(tracks[2], center, 0.8)]
    psi = sum(((p * RHO).exp() for p in pairs), lift(0.0)).log() * (1 / RHO)
    chain = [psi]
    for alpha, xi in ((A1, XI), (A2, 0.0), (A3, 0.0)):
        psi = psi.derivative() + psi * alpha + xi
        chain.append(psi)
    return [float(p.c[0]) for p in chain]


@given(seed=seeds)
@settings(max_examples=50, deadline=None)
def test_triple_integrators_composed_by_lse_are_their_taylor_series(triples, seed):
    x, u = state(27, seed), state(9, seed + 1)
    terms = triples(x)
    expected = psi_by_series(x, u)
    assert terms.psi == pytest.approx(expected[:3], **close)
    forced = sum(float(c @ w) for c, w in zip(terms.c.values(), u.reshape(3, 3), strict=True))
    assert terms.unforced + forced == pytest.approx(expected[3], rel=1e-8, abs=1e-7)


@given(seed=seeds)
def test_alpha_may_be_any_class_k_function(seed):
    x = state(4, seed)
    h = R**2 - np.sum((x[:2] - x[2:]) ** 2)
    terms = terms_of(SingleIntegrator(1.0), Power(0.5, 3.0))(x)
    assert terms.unforced == pytest.approx(0.5 * h**3, **close)


def test_a_power_of_psi_0_is_differentiated_in_psi_2():
    chain = build_chain(pair_of(DoubleIntegrator(1.0, 0.0, 2)), [Power(0.5, 3.0), A2])
    x = state(8, 3)
    d, v = x[:2] - x[4:6], x[2:4] - x[6:]
    h = R**2 - d @ d
    psi_1 = -2 * d @ v + 0.5 * h**3
    unforced = -2 * v @ v - 3.0 * h**2 * d @ v + A2 * psi_1
    assert TermsFunction(chain)(x).unforced == pytest.approx(unforced, **close)


def test_a_wall_is_a_half_plane_and_its_normal_needs_no_length():
    agent = Member("a", SingleIntegrator(1.0), False)
    composed = compose([agent], [Wall((0.0, 4.0), 1.0, 0.5)], Separation(R), RHO)
    terms = TermsFunction(build_chain(composed, [A1]))(np.array([7.0, 0.2]))
    assert terms.psi == pytest.approx([0.2 + 0.5 - 1.0])
    assert terms.c[0] == pytest.approx([0.0, 1.0])


def test_mixed_relative_degree_is_refused_and_says_who():
    members = [
        Member("slow", DoubleIntegrator(1.0, 0.0, 2), False),
        Member("fast", SingleIntegrator(1.0), False),
    ]
    with pytest.raises(RelativeDegreeError, match=r"of fast appear in ψ_1.* slow only later"):
        build_chain(compose(members, [], Separation(R), RHO), [A1])
