"""Rows of pairs: shares add up, and what is not known counts at its worst."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.margins.margin import RowPart
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.rows.composed import SwarmTerms
from phalanx.theory.rows.decision import decide_pairs
from phalanx.theory.rows.pairs import OwnPair, OwnPairTerms, PairRowFunction, pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import FAR, Member
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere
from phalanx.theory.safety.pairs import SwarmPairs

ETA = 0.8
seeds = st.integers(0, 2**32 - 1)


MEMBERS = (
    Member("a", SingleIntegrator(2.0), False),
    Member("b", SingleIntegrator(2.0), False),
    Member("c", SingleIntegrator(1.0), True),
)
SPHERE = Sphere((0.0, 5.0), 1.0)


@cache
def own_terms(i: int, radius: float | None = None) -> OwnPairTerms:
    pairs = SwarmPairs(MEMBERS, [SPHERE], Separation(1.0), 1)
    functions = {
        (other, part): row_function(pairs, i, other, part)
        for other in {0, 1, 2, 3} - {i}
        for part in (RowPart if other < 2 else [RowPart.WHOLE])
    }
    near = SwarmTerms(pairs, 1.0, [Linear(1.5)], 0.0).obstacles_within(i, radius)
    return OwnPairTerms(pairs, i, lambda other, part: functions[other, part], near)


def row_function(pairs: SwarmPairs, i: int, other: int, part: RowPart) -> PairRowFunction:
    a, b = pairs.ordered(i, other)
    own = OwnPair(build_chain(pairs.alone(a, b), [1.5]), 0 if a == i else 1)
    return PairRowFunction(own, part, ca.SX(part.value * ETA))


@given(seed=seeds)
def test_the_halves_of_two_normal_agents_add_up_to_their_pairs_condition(seed):
    x = np.random.default_rng(seed).uniform(-3, 3, 6)
    rows = {}
    for i in (0, 1):
        rows[i] = pair_rows(own_terms(i)(x, sharing=[0, 1]), {})
    d = x[:2] - x[2:4]
    assert rows[0].a[0] == pytest.approx(-2 * d)
    assert rows[1].a[0] == pytest.approx(2 * d)
    condition = 1.5 * (1 - d @ d) + ETA
    assert rows[0].bound[0] + rows[1].bound[0] == pytest.approx(-condition)


@given(seed=seeds)
def test_a_pair_with_an_adversary_or_an_obstacle_is_the_normal_agents_alone(seed):
    x = np.random.default_rng(seed).uniform(-3, 3, 6)
    terms = own_terms(0)(x, sharing=[0, 1])
    rows = pair_rows(terms, {})
    d, o = x[:2] - x[4:], x[:2] - np.array([0.0, 5.0])
    worst = 2 * np.abs(d).sum()
    assert terms.others == (1, 2, 3)
    assert terms.half.tolist() == [True, False, False]
    assert rows.bound[1] == pytest.approx(-(1.5 * (1 - d @ d) + worst + ETA))
    assert rows.bound[2] == pytest.approx(-(1.5 * (1 - o @ o) + ETA))
    assert rows.a[2] == pytest.approx(-2 * o)


def test_a_neighbour_that_shares_no_more_counts_at_its_worst_and_a_received_input_as_it_is():
    x = np.array([0.0, 0.0, 1.5, 0.0, 9.0, 9.0])
    terms = own_terms(0)(x)
    alpha = 1.5 * (1 - 2.25)
    alone = pair_rows(terms, {})
    assert alone.bound[0] == pytest.approx(-(alpha + 3.0 * 2.0 + ETA))
    informed = pair_rows(terms, {1: np.array([0.5, -1.0])})
    assert informed.bound[0] == pytest.approx(-(alpha - 3.0 * 0.5 + ETA))


def test_there_are_rows_for_what_is_seen_alone():
    x = np.array([0.0, 0.0, np.nan, np.nan, 3.0, 0.0])
    terms = own_terms(0, 4.9)(x, (0, 2))
    assert terms.others == (2,)
    assert pair_rows(terms, {}).bound.shape == (1,)
    assert own_terms(0, 5.1)(x, (0, 2)).others == (2, 3)
    alone = own_terms(0, 4.9)(x, (0,))
    assert alone.others == ()
    rows = pair_rows(alone, {})
    u_nom, polytope = (
        np.array([1.5, -3.0]),
        constant_polytope(*SingleIntegrator(2.0).input_polytope(ca.SX.sym("x", 2))),
    )
    decision = decide_pairs(polytope, rows, u_nom, NearestInput((1.0, 1.0)))
    assert decision.u.tolist() == [1.5, -2.0]
    assert decision.residual == FAR
