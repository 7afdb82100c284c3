"""Factors of a motion under a held input."""

import numpy as np
import pytest

from phalanx.knowledge.held import held, moved

CASES = [(0.0, 0.3), (1e-9, 2.0), (0.56, 0.05), (0.56, 3.0), (2.0, 15.0), (3.0, 500.0)]


@pytest.mark.parametrize(("drag", "time"), CASES)
def test_factors_are_those_of_the_exact_solution(drag, time):
    factors = held(np.array([drag]), np.array([time]))
    k = -np.expm1(-drag * time) / drag if drag else time
    small = drag * time < 1e-4
    reach = time**2 / 2 * (1 - drag * time / 3) if small else (time - k) / drag
    assert factors.decay == pytest.approx(np.exp(-drag * time), rel=1e-12, abs=1e-16)
    assert factors.speed == pytest.approx(k, rel=1e-13)
    assert factors.reach == pytest.approx(reach, rel=1e-12)


def test_two_holds_after_one_another_are_one_of_their_sum():
    x, u, drag = np.array([1.0, -2.0, 0.5, 3.0]), np.array([0.7, -4.0]), np.array([0.8])
    twice = x
    for time in (0.3, 1.1):
        twice = moved(twice, u, held(drag, np.array([time])))
    np.testing.assert_allclose(twice, moved(x, u, held(drag, np.array([1.4]))), rtol=1e-13)
