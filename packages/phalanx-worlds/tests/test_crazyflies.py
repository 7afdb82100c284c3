"""Crazyflies by another project's identified model, as a world."""

import importlib
import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from phalanx_testing import check_world
from phalanx_worlds.crazyflies import Crazyflies

import phalanx
from phalanx.extend import IdentifiedQuadrotor, Quadrotor, TripleIntegrator, WorldAgent
from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.swarm.swarm import build_swarm

START = np.array([1.0, 2.0, 3.0, 0.4, -0.3, 0.2, 0.5, 0.1, -0.05])


def drones(*names, start=START):
    return [WorldAgent(name, Quadrotor(thrust=4.0, tilt=0.4), start) for name in names]


def flown(u, until, world=None):
    world = world or Crazyflies()
    world.begin(drones("one"), 0, 1e-3)
    world.hold("one", np.array(u))
    return world.advance(until).x["one"]


@pytest.mark.parametrize("model", ["so_rpy_rotor", "so_rpy_rotor_drag"])
def test_crazyflies_keep_the_rules_of_a_world(model):
    check_world(lambda: Crazyflies(model=model), drones("one", "two"))


def test_a_crazyflie_starts_where_it_is_put_and_moves_on_from_there():
    first = flown([0.0, 0.0, 0.0], 1e-3)[0]
    np.testing.assert_allclose(first, START, atol=1e-2)
    np.testing.assert_allclose(first[:3] - START[:3], 1e-3 * START[3:6], atol=1e-5)
    assert len(flown([0.0, 0.0, 0.0], 10.5e-3)) == 11, "no step is longer than 1 ms"


@pytest.mark.parametrize("drone", ["cf2x_L250", "cf2x_P250", "cf2x_T350", "cf21B_500"])
def test_a_crazyflie_reaches_the_thrust_and_the_angles_that_it_is_given(drone):
    reached = flown([0.7, 0.2, -0.1], 3.0, Crazyflies(drone))[-1]
    np.testing.assert_allclose(reached[6:], [0.7, 0.2, -0.1], atol=1e-6)


def test_pitch_pushes_forward_and_roll_to_the_right_as_in_the_declared_dynamics():
    still = flown([0.0, 0.0, 0.0], 1.0)[-1]
    forward, right = flown([0.0, 0.2, 0.0], 1.0)[-1], flown([0.0, 0.0, 0.2], 1.0)[-1]
    assert forward[0] > still[0] + 0.3
    assert right[1] < still[1] - 0.3


@pytest.mark.parametrize("field", ["drone", "model"])
def test_names_that_the_package_does_not_have_are_refused(field):
    with pytest.raises(ValueError, match=f"{field}: drone-models has no none"):
        flown([0.0, 0.0, 0.0], 0.1, Crazyflies(**{field: "none"}))


def test_drones_with_other_coordinates_are_refused():
    with pytest.raises(ValueError, match="agent one: expected dynamics with states of quadrotor"):
        Crazyflies().require_robots({"one": TripleIntegrator(jerk=4.0)})


FITTED = "so_rpy_rotor_drag"
SWINGING = [*START, 0.3, 0.4, -0.6]


def shipped():
    """The declared dynamics of the shipped scenario."""
    return build_swarm(phalanx.load("worlds/crazyflies")).members[0].dynamics


def identified(*names):
    return [WorldAgent(name, shipped(), np.array(SWINGING)) for name in names]


def test_the_shipped_scenario_declares_identified_quadrotors():
    dynamics = shipped()
    assert isinstance(dynamics, IdentifiedQuadrotor)
    assert dynamics.states[9:] == ("r", "theta_rate", "phi_rate")


def test_identified_quadrotors_keep_the_rules_of_a_world():
    check_world(lambda: Crazyflies("cf2x_P250", FITTED), identified("one", "two"))


def test_the_declared_parameters_are_those_of_the_package():
    of = importlib.import_module("drone_models.core").load_params(FITTED, "cf2x_P250")
    dynamics = shipped()
    assert dynamics.thrust_lag == pytest.approx(float(of["thrust_time_coef"]), rel=1e-4)
    assert dynamics.stiffness == pytest.approx(-of["rpy_coef"][0])
    assert dynamics.damping == pytest.approx(-of["rpy_rates_coef"][0])
    assert dynamics.drag == pytest.approx(-of["drag_matrix"][0][0] / of["mass"], rel=1e-4)


@pytest.mark.parametrize("u", [[0.0, 0.0, 0.0], [1.5, 0.2, -0.1], [-2.0, -0.3, 0.3]])
def test_the_declared_dynamics_explain_the_fit_but_for_the_difference_of_drags(u):
    world, start = Crazyflies("cf2x_P250", FITTED), np.array([SWINGING])
    world.begin(identified("one"), 0, 3e-4)
    world.hold("one", np.array(u))
    states = np.vstack([start, world.advance(0.5).x["one"]])
    seconds = np.full(len(states) - 1, 0.5 / (len(states) - 1))
    held = np.broadcast_to(np.array(u), (len(seconds), 3))
    phi, size = DisturbanceLedger(shipped()).explain(states[:-1], states[1:], held, seconds)
    # Drag along the thrust is larger than across it, by 0.103 / s.
    speed = np.linalg.norm(states[:, 3:6], axis=1).max()
    assert (size <= 0.103 * speed).all()
    np.testing.assert_allclose(np.delete(phi, [3, 4, 5], axis=1), 0.0, atol=1e-5)


@pytest.mark.nightly
def test_a_declared_lag_that_is_wrong_needs_a_larger_disturbance():
    world, u = Crazyflies("cf2x_P250", FITTED), np.array([[1.0, 0.2, 0.0]])
    world.begin(identified("one"), 0, 3e-4)
    world.hold("one", u[0])
    end = world.advance(0.01).x["one"][-1:]
    slower = replace(shipped(), stiffness=250.0)
    for dynamics, low, high in ((shipped(), 0.0, 0.1), (slower, 5.0, 20.0)):
        explained = DisturbanceLedger(dynamics).explain(
            np.array([SWINGING]), end, u, np.array([0.01])
        )
        assert low <= explained.size[0] <= high
