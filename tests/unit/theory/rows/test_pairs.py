"""Rows of pairs: shares add up, and what is not known counts at its worst."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.rows.pairs import PairTermsFunction, own_pairs, pair_rows
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere

ETA = 0.8
seeds = st.integers(0, 2**32 - 1)


@cache
def swarm_pairs():
    members = [
        Member("a", SingleIntegrator(2.0), False),
        Member("b", SingleIntegrator(2.0), False),
        Member("c", SingleIntegrator(1.0), True),
    ]
    composed = compose(members, [Sphere((0.0, 5.0), 1.0)], Separation(1.0), 1.0)
    chains = {p: build_chain(composed.alone(p), [1.5]) for p in range(len(composed.pairs))}
    return composed, chains


@cache
def own_terms(i: int):
    composed, chains = swarm_pairs()
    pairs = own_pairs(composed, chains, i)
    margins = [(ca.SX(ETA), ca.SX(ETA / 2 if pair.shared else 0.0)) for pair in pairs]
    return pairs, PairTermsFunction(composed, pairs, margins)


@given(seed=seeds)
def test_the_halves_of_two_normal_agents_add_up_to_their_pairs_condition(seed):
    x = np.random.default_rng(seed).uniform(-3, 3, 6)
    rows = {}
    for i in (0, 1):
        pairs, function = own_terms(i)
        rows[i] = pair_rows(function(x), pairs, {}, [0, 1])
    d = x[:2] - x[2:4]
    assert rows[0].a[0] == pytest.approx(-2 * d)
    assert rows[1].a[0] == pytest.approx(2 * d)
    condition = 1.5 * (1 - d @ d) + ETA
    assert rows[0].bound[0] + rows[1].bound[0] == pytest.approx(-condition)


@given(seed=seeds)
def test_a_pair_with_an_adversary_or_an_obstacle_is_the_normal_agents_alone(seed):
    x = np.random.default_rng(seed).uniform(-3, 3, 6)
    pairs, function = own_terms(0)
    rows = pair_rows(function(x), pairs, {}, [0, 1])
    d, o = x[:2] - x[4:], x[:2] - np.array([0.0, 5.0])
    worst = 2 * np.abs(d).sum()
    assert [p.other for p in pairs] == [1, 2, None]
    assert rows.bound[1] == pytest.approx(-(1.5 * (1 - d @ d) + worst + ETA))
    assert rows.bound[2] == pytest.approx(-(1.5 * (1 - o @ o) + ETA))
    assert rows.a[2] == pytest.approx(-2 * o)


def test_a_neighbour_that_shares_no_more_counts_at_its_worst_and_a_received_input_as_it_is():
    x = np.array([0.0, 0.0, 1.5, 0.0, 9.0, 9.0])
    pairs, function = own_terms(0)
    terms = function(x)
    alpha = 1.5 * (1 - 2.25)
    alone = pair_rows(terms, pairs, {}, [0])
    assert alone.bound[0] == pytest.approx(-(alpha + 3.0 * 2.0 + ETA))
    told = pair_rows(terms, pairs, {1: np.array([0.5, -1.0])}, [])
    assert told.bound[0] == pytest.approx(-(alpha - 3.0 * 0.5 + ETA))
