"""Every draw is a pure function of (seed, purpose, index); so are the instants of a clock."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from phalanx.network.draws import Draws, SamplingClock
from phalanx.network.loss import Outside
from phalanx.network.rule import AtLeast

indices = st.lists(st.integers(0, 5000), min_size=1, max_size=40)


@given(indices)
def test_a_draw_does_not_depend_on_what_was_drawn_before(order):
    table = Draws(7, "jitter", "1", width=3)
    for index in order:
        assert (table[index] == Draws(7, "jitter", "1", width=3)[index]).all()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((0, "jitter", "1"), (1, "jitter", "1")),
        ((0, "jitter", "1"), (0, "jitter", "2")),
        ((0, "jitter", "1"), (0, "clock", "1")),
        ((0, "link", "a", "bc"), (0, "link", "ab", "c")),
        ((1, "1"), (11, "")),
        ((0, "link", "a", "b"), (0, "link", "b", "a")),
    ],
)
def test_another_seed_or_purpose_gives_other_draws(one, other):
    first = [float(Draws(*one)[k][0]) for k in range(100)]
    second = [float(Draws(*other)[k][0]) for k in range(100)]
    assert not set(first) & set(second)


def test_draws_never_repeat_across_blocks():
    table = Draws(0, "x", width=2)
    values = np.concatenate([table[k] for k in range(2000)])
    assert len(np.unique(values)) == len(values)


def test_the_last_row_is_found_however_many_blocks_it_lies_back():
    table, rare = Draws(0, "x"), AtLeast(0, 0.998)
    rows = [table.value(k) >= 0.998 for k in range(4000)]
    assert max(np.diff(np.flatnonzero(rows))) > 3 * 256
    expected = [max((j for j in range(k + 1) if rows[j]), default=0) for k in range(0, 4000, 97)]
    assert [table.last(k, rare) for k in range(0, 4000, 97)] == expected


def test_conditions_of_two_kinds_with_the_same_numbers_are_two():
    table = Draws(0, "x", width=2)
    everywhere = [table.last(k, Outside(1, 0.9)) for k in range(100, 120)]
    assert everywhere == list(range(100, 120))
    assert [table.last(k, AtLeast(1, 0.9)) for k in range(100, 120)] != everywhere


def test_draws_are_uniform_in_the_unit_interval():
    table = Draws(0, "x")
    values = np.array([table[k][0] for k in range(4000)])
    assert values.min() >= 0.0
    assert values.max() < 1.0
    assert kstest(values, "uniform").pvalue > 0.01


def test_the_bits_are_the_same_on_every_machine_and_in_every_version():
    """A change here makes every recording unverifiable: it must be deliberate."""
    assert [float(v).hex() for v in Draws(0, "clock", "1")[1000]] == ["0x1.f2bcad74b4ee4p-3"]


def gaps(clock: SamplingClock, count: int = 3000) -> np.ndarray:
    times = [0.0]
    for k in range(count):
        times.append(clock.after(k, times[-1]))
    return np.diff(times)


@given(seed=st.integers(0, 2**63 - 1), share=st.floats(0.0, 0.99))
def test_gaps_lie_within_the_period_plus_or_minus_the_jitter(seed, share):
    period, jitter = 0.01, 0.01 * share
    times = gaps(SamplingClock(seed, "1", period, jitter), 50)
    assert times.min() >= period - jitter - 1e-12
    assert times.max() <= period + jitter + 1e-12
    assert times.min() > 0.0


def test_gaps_use_the_whole_range_about_the_period():
    found = gaps(SamplingClock(0, "1", 0.01, 0.002))
    assert found.min() == pytest.approx(0.008, abs=1e-5)
    assert found.max() == pytest.approx(0.012, abs=1e-5)
    assert found.mean() == pytest.approx(0.01, abs=4 * 0.002 / np.sqrt(3 * len(found)))


def test_without_jitter_the_clock_is_periodic():
    assert gaps(SamplingClock(0, "1", 0.01, 0.0)) == pytest.approx(0.01)


def test_agents_and_seeds_have_clocks_of_their_own_and_plant_and_agent_share_one():
    clocks = [(0, "1"), (0, "2"), (1, "1")]
    drawn = {tuple(gaps(SamplingClock(*c, 0.01, 0.002), 20)) for c in clocks}
    assert len(drawn) == 3
    assert tuple(gaps(SamplingClock(0, "1", 0.01, 0.002), 20)) in drawn


def test_the_next_instant_depends_on_k_and_t_alone():
    clock = SamplingClock(0, "1", 0.01, 0.002)
    later = clock.after(900, 9.0)
    clock.after(3, 0.03)
    assert clock.after(900, 9.0) == later
