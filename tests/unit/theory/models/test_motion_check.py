"""The motion check: true motions are never convicted, lies beyond twice the bound always."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.bicycles import Bicycle
from examples.planar_quadrotors import PlanarQuadrotor
from phalanx.swarm.swarm import DEFECT
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.motion_check import MotionCheck
from phalanx.theory.models.wheeled import Unicycle
from tests.unit.theory.models.windows import windows

DYNAMICS: dict[str, Dynamics] = {
    "unicycle": Unicycle(4.0, 2.0),
    "single integrator": SingleIntegrator(4.0),
    "double integrator": DoubleIntegrator(3.0, drag=0.4),
    "bicycle": Bicycle(2.0, 0.5, 0.3),
    "quadrotor": PlanarQuadrotor(5.0, 0.5, 0.1, 0.1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DYNAMICS)
@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), bound=st.floats(0.0, 2.0), error=st.sampled_from([0.0, 0.003]))
def test_a_motion_within_the_bounds_is_never_convicted(name, seed, bound, error):
    check = MotionCheck(DYNAMICS[name], bound + DEFECT, error)
    true = windows(DYNAMICS[name], bound, error, 400, np.random.default_rng(seed))
    excess = check.excess(*true)
    assert (excess <= 0.0).all()
    assert np.isfinite(excess).mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("size", [3.0, 1e4, 1e8])
@pytest.mark.parametrize("name", DYNAMICS)
def test_a_true_motion_is_not_convicted_however_short_its_window_is(name, size):
    """Its samples are rounded, by up to 5e14 times its length."""
    check, random = MotionCheck(DYNAMICS[name], DEFECT), np.random.default_rng(0)
    true = windows(DYNAMICS[name], 0.0, 0.0, 2000, random, shortest=2.0**-53, size=size)
    assert (check.excess(*true) <= 0.0).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [0.0, 3.0])
def test_nor_within_the_shortest_window_of_all(size):
    T, own = 5e-324, DYNAMICS["single integrator"]
    x, u = np.full((1, 2), size), np.array([[[0.3, -3.0]]])
    excess = MotionCheck(own, DEFECT).excess(x, x + T * u[:, 0], u, np.array([[T]]))
    assert excess <= 0.0


def test_the_bound_is_used_up_by_a_steady_disturbance():
    check = MotionCheck(DYNAMICS["single integrator"], 1.0)
    true = windows(DYNAMICS["single integrator"], 1.0, 0.0, 400, np.random.default_rng(0))
    assert check.excess(*true).max() > -1e-6
    smaller = MotionCheck(DYNAMICS["single integrator"], 0.99)
    assert (smaller.excess(*true) > 0.0).any()


@pytest.mark.parametrize(("away", "T"), [(0.0, 0.01), (0.0, 1e-9), (1e4, 0.01), (1e4, 1e-6)])
def test_a_lie_of_more_than_twice_the_bound_is_convicted_in_its_window(away, T):
    dynamics, x = DYNAMICS["single integrator"], np.full((1, 2), away)
    check = MotionCheck(dynamics, 1.0)
    claimed, seconds = np.array([[[2.0, 0.0]]]), np.array([[T]])
    for off, convicted in ((1.99, False), (2.01, True)):
        # The disturbance helps the liar as much as it can.
        gone = T * np.array([[2.0 - off + 1.0, 0.0]])
        assert (check.excess(x, x + gone, claimed, seconds) > 0.0) == convicted


def test_what_is_not_convicted_is_explained_by_a_disturbance_within_the_bound():
    dynamics = DYNAMICS["single integrator"]
    lies = windows(dynamics, 0.5, 0.0, 4000, np.random.default_rng(3), false=0.3)
    excess = MotionCheck(dynamics, 1.0).excess(*lies)
    announced = (lies.u * lies.seconds[..., None]).sum(axis=1)
    needed = np.linalg.norm(lies.after - lies.before - announced, axis=1) / lies.seconds.sum(axis=1)
    assert 0.05 < (excess > 0.0).mean() < 0.95
    assert (needed[excess <= 0.0] <= 1.0 + 1e-6).all()
    assert (needed[excess > 0.0] > 1.0).all()


def test_a_window_without_a_box_is_no_conviction():
    check = MotionCheck(DYNAMICS["unicycle"], 1.0)
    x = np.zeros((1, 3))
    assert check.excess(x, x, np.full((1, 1, 2), np.inf), np.ones((1, 1))) == -np.inf
