"""Sensors measure the true state itself, unless a fault is in force."""

import numpy as np
import pytest

from phalanx.faults.onboard import Sensors
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm


def sensors(**fault: object) -> tuple[Sensors, np.ndarray]:
    """Return the sensors of Simulation 1, agent 2's with a fault from 1 s to 2 s, and x(0)."""
    declared = {"kind": "sensor", "agents": ["2"], "at": 1.0, "for": 1.0, **fault}
    swarm = build_swarm(load("unicycles", {"faults": [declared]}))
    states = {member.name: member.dynamics.states for member in swarm.members}
    return Sensors(states, swarm.seed, swarm.links.occurrences), swarm.start()


def test_a_biased_sensor_is_wrong_about_its_own_robot_while_the_fault_lasts_and_never_else():
    faulty_sensors, x = sensors(bias={"x": 0.5})
    for i in range(5):
        for k, t in enumerate((0.999, 1.0, 1.999, 2.0)):
            measured = faulty_sensors.measured(i, k, t, x)
            if i == 1 and 1.0 <= t < 2.0:
                assert measured is not x
                assert (np.flatnonzero(measured != x) == [3]).all()
                assert measured[3] == x[3] + 0.5
            else:
                assert measured is x
    assert list(faulty_sensors.faults.values()) == [2]


def test_a_silent_sensor_has_no_measurement_error():
    found, x = sensors(silent=True)
    assert found.measured(1, 0, 1.5, x) is x
    assert not found.faults


def test_noise_is_drawn_by_sample_and_as_large_as_declared():
    found, x = sensors(noise={"y": 0.1})
    errors = [found.measured(1, k, 1.5, x)[4] - x[4] for k in range(2000)]
    again = [found.measured(1, k, 1.5, x)[4] - x[4] for k in range(2000)]
    assert errors == again
    assert np.std(errors) == pytest.approx(0.1, rel=0.1)
