"""Sampling instants of Eq. (perturbedT)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.seeded.draws import SamplingClock


def gaps(clock: SamplingClock, count: int = 3000) -> np.ndarray:
    times = [0.0]
    for k in range(count):
        times.append(clock.after(k, times[-1]))
    return np.diff(times)


@given(seed=st.integers(0, 2**63 - 1), share=st.floats(0.0, 0.99))
def test_gaps_lie_within_the_period_plus_or_minus_the_jitter(seed, share):
    period, jitter = 0.01, 0.01 * share
    found = gaps(SamplingClock(seed, "1", period, jitter), 50)
    assert found.min() >= period - jitter - 1e-12
    assert found.max() <= period + jitter + 1e-12
    assert found.min() > 0.0


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
