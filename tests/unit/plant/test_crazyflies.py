"""Crazyflies by another project's identified model, as a world."""

import importlib.util

import numpy as np
import pytest

from phalanx.extend import PlanarQuadrotor, Quadrotor, WorldAgent
from phalanx.testing import check_world
from phalanx.worlds.crazyflies import Crazyflies

needs_models = pytest.mark.skipif(
    importlib.util.find_spec("drone_models") is None,
    reason="needs drone-models: pip install 'phalanx-swarm[drone-models]'",
)
START = np.array([1.0, 2.0, 3.0, 0.4, -0.3, 0.2, 0.5, 0.1, -0.05])


def drones(*names, start=START):
    return [WorldAgent(name, Quadrotor(thrust=4.0, tilt=0.4), start) for name in names]


def flown(u, until, world=None):
    world = world or Crazyflies()
    world.begin(drones("one"), 0, 1e-3)
    world.hold("one", np.array(u))
    return world.advance(until).x["one"]


@needs_models
@pytest.mark.parametrize("model", ["so_rpy_rotor", "so_rpy_rotor_drag"])
def test_crazyflies_keep_the_rules_of_a_world(model):
    check_world(lambda: Crazyflies(model=model), drones("one", "two"))


@needs_models
def test_a_crazyflie_starts_where_it_is_put_and_moves_on_from_there():
    first = flown([0.0, 0.0, 0.0], 1e-3)[0]
    np.testing.assert_allclose(first, START, atol=1e-2)
    np.testing.assert_allclose(first[:3] - START[:3], 1e-3 * START[3:6], atol=1e-5)


@needs_models
@pytest.mark.parametrize("drone", ["cf2x_L250", "cf2x_P250", "cf2x_T350", "cf21B_500"])
def test_a_crazyflie_reaches_the_thrust_and_the_angles_that_it_is_given(drone):
    reached = flown([0.7, 0.2, -0.1], 3.0, Crazyflies(drone))[-1]
    np.testing.assert_allclose(reached[6:], [0.7, 0.2, -0.1], atol=1e-6)


@needs_models
def test_pitch_pushes_forward_and_roll_to_the_right_as_in_the_declared_dynamics():
    still = flown([0.0, 0.0, 0.0], 1.0)[-1]
    forward, right = flown([0.0, 0.2, 0.0], 1.0)[-1], flown([0.0, 0.0, 0.2], 1.0)[-1]
    assert forward[0] > still[0] + 0.3
    assert right[1] < still[1] - 0.3


@needs_models
@pytest.mark.parametrize("field", ["drone", "model"])
def test_names_that_the_package_does_not_have_are_refused(field):
    with pytest.raises(ValueError, match=f"{field}: drone-models has no none"):
        flown([0.0, 0.0, 0.0], 0.1, Crazyflies(**{field: "none"}))


@needs_models
def test_drones_with_other_coordinates_are_refused():
    other = WorldAgent("one", PlanarQuadrotor(thrust=4.0, tilt=0.4), np.zeros(6))
    with pytest.raises(ValueError, match="agent one: expected dynamics with states of quadrotor"):
        Crazyflies().begin([other], 0, 1e-3)
