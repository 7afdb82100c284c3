"""Terms composed from pairs, against the chain of the whole swarm as one expression."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.rows.composed import ComposedTerms, SwarmTerms
from phalanx.theory.rows.row import Terms
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import Linear, Power
from phalanx.theory.safety.composition import FAR, Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.pairs import SwarmPairs
from tests.unit.theory.sample_swarms import AROUND, DEGREES, RHO, sample_swarm
from tests.unit.theory.whole_expression import TermsFunction, in_sight

ALPHAS = (Power(0.8, 3.0), Linear(1.7), Power(0.6, 2.0))
XI, ETA, REACH = 2.5, 1.3, 2.5
PARTS = ("c", "least", "most", "positions")
seeds = st.integers(0, 2**32 - 1)


@cache
def swarm_terms(name: str) -> SwarmTerms:
    composed = sample_swarm(name)
    pairs = SwarmPairs(composed.members, composed.obstacles, composed.function, DEGREES[name])
    return SwarmTerms(pairs, RHO, ALPHAS[: DEGREES[name]], XI)


@cache
def reference(name: str, i: int | None) -> TermsFunction:
    """Terms of all pairs, or of those within agent i's neighbourhood."""
    composed = sample_swarm(name)
    in_reach = composed if i is None else in_sight(composed, i, REACH)
    return TermsFunction(build_chain(in_reach, ALPHAS[: DEGREES[name]], XI), ETA)


@cache
def composed_terms(name: str, i: int, radius: float | None) -> ComposedTerms:
    return swarm_terms(name).of(i, radius, ETA)


def numbers(terms: Terms) -> np.ndarray:
    """All that terms say, one number after the other."""
    fields = [terms.psi, [terms.unforced, terms.margin]]
    for by_member in (terms.c, terms.least, terms.most, terms.positions):
        fields += [by_member[l] for l in sorted(by_member)]
    for l in sorted(terms.c):
        fields += [terms.polytopes[l].A, terms.polytopes[l].b]
    return np.concatenate([np.ravel(field) for field in fields])


def largest_difference(values: np.ndarray, expected: np.ndarray) -> float:
    """Relative to the numbers, or to 1."""
    return float((np.abs(values - expected) / np.maximum(1.0, np.abs(expected))).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", DEGREES)
def test_terms_of_all_pairs_are_those_of_the_whole_chain(name):
    """Compare at many states, from agents in one place to agents far apart."""
    composed, rng = sample_swarm(name), np.random.default_rng(7)
    terms, expected = composed_terms(name, 0, None), reference(name, None)
    distances = np.geomspace(0.1, 30.0, 400)
    for x in distances[:, None] * rng.uniform(-1.0, 1.0, (400, composed.x.numel())):
        assert largest_difference(numbers(terms(x)), numbers(expected(x))) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", DEGREES)
@given(seed=seeds)
@settings(max_examples=15)
def test_what_is_not_seen_has_no_part_and_may_be_anything(name, seed):
    composed = sample_swarm(name)
    x = np.random.default_rng(seed).uniform(-3.0, 3.0, composed.x.numel())
    expected = reference(name, 0)(x)
    distances = {
        l: np.linalg.norm(p - expected.positions[0]) for l, p in expected.positions.items()
    }
    in_reach = [l for l, distance in distances.items() if l == 0 or distance <= REACH]
    x_of_these = np.full_like(x, np.nan)
    for l in in_reach:
        x_of_these[composed.parts[l]] = x[composed.parts[l]]
    terms = composed_terms(name, 0, REACH)(x_of_these, in_reach)
    assert sorted(terms.c) == sorted(terms.least) == sorted(terms.most) == in_reach
    if terms.psi[0] == FAR:
        assert expected.psi[0] == pytest.approx(FAR)
        assert not any(c.any() for c in terms.c.values())
    else:
        parts = {part: {l: getattr(expected, part)[l] for l in in_reach} for part in PARTS}
        assert largest_difference(numbers(terms), numbers(expected._replace(**parts))) < 1e-12


@pytest.mark.parametrize("name", DEGREES)
def test_an_agent_alone_is_safe_and_free(name):
    composed = sample_swarm(name)
    x = np.full(composed.x.numel(), np.nan)
    x[composed.parts[0]] = -1e3
    terms = composed_terms(name, 0, REACH)(x, (0,))
    assert terms.psi.tolist() == [FAR, *terms.psi[1:].tolist()]
    assert (terms.psi < -1e6).all()
    assert terms.unforced < 0.0
    assert not terms.c[0].any()


@pytest.mark.parametrize("name", DEGREES)
def test_terms_do_not_depend_on_what_was_asked_before(name):
    """Memory is kept between calls, and who is seen changes."""
    composed = sample_swarm(name)
    members = len(composed.members)
    random = np.random.default_rng(4)
    states = random.uniform(-3.0, 3.0, (12, composed.x.numel()))
    terms_at = composed_terms(name, 0, REACH)
    for x in states:
        visible = tuple(l for l in range(members) if l == 0 or random.random() < 0.5)
        terms, fresh = terms_at(x, visible), swarm_terms(name).of(0, REACH, ETA)(x, visible)
        for part in ("psi", "unforced"):
            assert np.array_equal(getattr(terms, part), getattr(fresh, part))
        for l in visible:
            assert terms.c[l].tobytes() == fresh.c[l].tobytes()
            assert terms.least[l] == fresh.least[l]


def test_one_pair_is_its_own_composition():
    """No LSE rounds it: h_tot is h, to the bit."""
    composed = sample_swarm("unicycles")
    x = np.random.default_rng(3).uniform(-3.0, 3.0, composed.x.numel())
    terms = composed_terms("unicycles", 0, 1e-3)(x, (0, 4))
    pair = composed.pairs.index(next(p for p in composed.pairs if (p.a, p.b) == (0, 4)))
    h = ca.Function("h", [composed.x], [composed.h[pair]])
    assert terms.psi[0] == pytest.approx(float(h(x)), rel=1e-15)


@pytest.mark.slow
def test_a_crowd_is_composed_like_a_few():
    """Memory is for more pairs and members than there are: what fills it has no part."""
    members = [Member(f"a{l}", Unicycle(4.0, 2.0), l >= 17) for l in range(19)]
    composed = compose(members, AROUND, Separation(1.0), RHO)
    pairs = SwarmPairs(composed.members, composed.obstacles, composed.function, 1)
    terms = SwarmTerms(pairs, RHO, ALPHAS[:1], XI).of(0, None, ETA)
    whole = TermsFunction(build_chain(composed, ALPHAS[:1], XI), margin=ETA)
    for x in np.random.default_rng(8).uniform(-9.0, 9.0, (20, composed.x.numel())):
        assert largest_difference(numbers(terms(x)), numbers(whole(x))) < 1e-12
