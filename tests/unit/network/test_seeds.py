"""Seeds that replace one another: a draw is that of the seed in force when it is decided."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.network.draws import Draws, SamplingClock, Seeds, Tables
from phalanx.network.link import Link
from phalanx.network.rule import AtLeast
from tests.unit.network.models import model

CHANGES = st.lists(
    st.tuples(st.floats(0.1, 9.9), st.integers(0, 9)), max_size=4, unique_by=lambda each: each[0]
).map(sorted)


@given(CHANGES, st.floats(0.0, 10.0))
def test_the_seed_in_force_is_that_of_the_last_change(changes, t):
    past = [seed for at, seed in changes if at <= t]
    assert Seeds(42, changes).at(t) == [42, *past][-1]


@pytest.mark.slow
@given(CHANGES)
def test_each_row_is_that_of_the_seed_in_force_when_it_was_decided(changes):
    seeds = Seeds(42, changes)
    tables = Tables(seeds, "jitter", "1", width=2)
    for row in range(600):
        t = row / 60.0
        of_seed = Draws(seeds.at(t), "jitter", "1", width=2)[row]
        assert (tables.decide(row, t)()[row] == of_seed).all()


def test_rows_decided_before_a_change_stay_also_in_tables_of_other_purposes():
    tables = Tables(Seeds(1, [(3.0, 2)]), "link")
    for row in range(301):
        tables.decide(row, row / 100)
    late = tables["made after the change"]
    one, other = (Draws(seed, "link", "made after the change") for seed in (1, 2))
    assert [late.value(k) for k in range(300)] == [one.value(k) for k in range(300)]
    assert [late.value(k) for k in range(300, 600)] == [other.value(k) for k in range(300, 600)]


def test_what_looks_back_finds_what_was_decided_before():
    tables = Tables(Seeds(1, [(3.0, 2)]), "link")
    holds = AtLeast(0, 0.99)
    last = [tables.decide(k, k / 100)().last(k, holds) for k in range(600)]
    at_once = tables()
    hits = [k for k in range(600) if at_once.value(k) >= 0.99]
    assert last == [max([h for h in hits if h <= k], default=0) for k in range(600)]


@given(st.integers(1, 198), st.integers(1, 9))
def test_links_and_clocks_change_with_the_seed_and_not_before(first, seed):
    changed, plain = Seeds(0, [(first / 100, seed)]), Seeds(0)
    lossy = model(loss={"mean": 0.3, "burst": 4.0}, delay={"low": 0.0, "high": 0.1}, duplicate=0.2)
    fates, gaps = [], []
    for seeds in (changed, plain):
        link = Link(seeds, "a", "b", lossy)
        fates.append([link.fate(k, k / 100, now=k / 100) for k in range(200)])
        clock = SamplingClock(seeds, "1", 0.01, 0.002)
        gaps.append([clock.after(k, 0.0, k / 100) for k in range(200)])
    for one, other in (fates, gaps):
        assert one[:first] == other[:first]
    assert gaps[0][first] != gaps[1][first]
    assert np.not_equal(gaps[0][first:], gaps[1][first:]).all()


def test_a_link_that_is_bad_stays_bad_until_a_new_draw_says_otherwise():
    """Bursts of mean length 50: a new seed must not decide again in which state the link is."""
    bursty = model(loss={"mean": 0.5, "burst": 50.0})
    turned = 0
    for seed in range(200):
        link = Link(Seeds(seed, [(1.0, seed + 1000)]), "a", "b", bursty)
        lost = [link.fate(k, k / 100, now=k / 100).delay is None for k in range(101)]
        turned += lost[99] != lost[100]
    assert turned < 15, "of 200, 4 are expected; were the state drawn again it would be 100"


def test_a_network_without_a_change_draws_as_always():
    of_number, of_seeds = (Link(s, "a", "b", model(loss=0.5)) for s in (3, Seeds(3)))
    assert [of_number.fate(k) for k in range(50)] == [of_seeds.fate(k) for k in range(50)]
