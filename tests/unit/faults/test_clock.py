"""Faults of clocks and sensors: their size, begin and end, and count."""

from typing import Any

import numpy as np
import pytest

from phalanx.faults.onboard import AgentClock, Sensors
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm

PERIOD, JITTER, AT, OVER, END = 0.01, 0.002, 1.0, 1.5, 3.0


def ticks(
    count: int = 1, others: tuple[dict[str, Any], ...] = (), **fault: Any
) -> tuple[AgentClock, np.ndarray]:
    """Agent 1's clock with other faults, then so many of one, and all its ticks."""
    repeated = [{"kind": "clock", "at": AT, "agents": ["1"], **fault}] * count if fault else []
    faults = [*others, *repeated]
    swarm = build_swarm(load("unicycles", {"faults": faults}))
    clock = AgentClock(swarm.clock(0), swarm.time.latency, swarm.links.occurrences)
    times = [0.0]
    while times[-1] < END:
        assert len(times) < 2 * END / (PERIOD - JITTER)
        times.append(clock.after(len(times) - 1, times[-1]))
    return clock, np.array(times)


RIGHT = ticks()[1]


def test_a_clock_without_a_fault_is_the_perturbed_one():
    gaps = np.diff(RIGHT)
    assert (np.abs(gaps - PERIOD) <= JITTER + 1e-12).all()


@pytest.mark.parametrize("step", [0.2, 0.003])
def test_a_step_delays_every_later_sample_by_as_much(step: float):
    clock, times = ticks(step=step)
    before = RIGHT <= AT
    assert (times[: before.sum()] == RIGHT[before]).all()
    after = slice(before.sum(), before.sum() + 50)
    assert times[after] == pytest.approx(RIGHT[after] + step, abs=1e-9)
    assert clock.faults == {0: 1}


def test_a_fault_of_something_else_before_it_hides_no_fault_of_a_clock():
    sensor = {"kind": "sensor", "at": 0.0, "for": 9.0, "agents": ["1"], "bias": {"x": 1.0}}
    clock, times = ticks(others=(sensor,), step=0.2)
    assert (times == ticks(step=0.2)[1]).all()
    assert clock.faults == {1: 1}


def test_a_step_at_the_very_instant_of_a_sample_delays_the_next_one():
    clock, times = ticks(step=0.2, at=0.0)
    assert times[1] == pytest.approx(RIGHT[1] + 0.2)
    assert clock.faults == {0: 1}


def test_a_step_forward_has_a_sample_come_sooner_but_not_before_it():
    clock, times = ticks(step=-0.005)
    n = int((RIGHT <= AT).sum())
    assert times[n] == pytest.approx(max(AT, RIGHT[n] - 0.005), abs=1e-9)
    assert (np.diff(times) > 0.0).all()
    assert clock.faults == {0: 1}


def test_a_clock_that_is_set_far_ahead_samples_no_sooner_than_its_last_input_takes_effect():
    """Else that input would be lost, or overtake the next one."""
    swarm = build_swarm(load("unicycles"))
    fault = {"kind": "clock", "at": 0.001, "agents": ["1"], "step": -0.5}
    occurrences = build_swarm(load("unicycles", {"faults": [fault]})).links.occurrences
    assert AgentClock(swarm.clock(0), 0.004, occurrences).after(0, 0.0) == np.nextafter(0.004, 1.0)


def test_a_skew_ends_with_its_time_as_far_as_samples_can_come_sooner():
    clock, times = ticks(skew=0.004, **{"for": OVER - AT})
    n, m = int((RIGHT <= AT).sum()), int((times <= OVER).sum())
    assert times[n : m - 1] == pytest.approx(RIGHT[n : m - 1] + 0.004, abs=1e-9)
    delays = times[m : m + 50] - RIGHT[m : m + 50]
    assert delays == pytest.approx(delays[0], abs=1e-9)
    assert 0.0 <= delays[0] == pytest.approx(max(OVER - RIGHT[m], 0.0), abs=1e-9)
    assert clock.faults == {0: 2}


@pytest.mark.parametrize("drift", [0.5, -0.3])
def test_a_drift_stretches_every_gap_of_its_time_and_no_other(drift: float):
    clock, times = ticks(drift=drift, **{"for": OVER - AT})
    n = min(len(times), len(RIGHT)) - 1
    stretched = np.diff(times)[:n] / np.diff(RIGHT)[:n]
    during = (times[:n] >= AT) & (times[:n] < OVER)
    assert stretched[during] == pytest.approx(1.0 + drift)
    assert stretched[~during] == pytest.approx(1.0)
    assert clock.faults == {0: during.sum()}


@pytest.mark.parametrize(("drift", "total"), [(-0.2, -0.4), (-0.45, -0.5), (8.0, 10.0)])
def test_drifts_at_once_add_up_within_the_bounds_of_one(drift: float, total: float):
    clock, times = ticks(count=2, drift=drift, **{"for": END})
    n = min(len(times), len(RIGHT)) - 1
    during = times[:n] >= AT
    stretched = np.diff(times)[:n] / np.diff(RIGHT)[:n]
    assert stretched[during] == pytest.approx(1.0 + total)
    assert clock.faults[0] == clock.faults[1] > 0


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
    sensed, x = sensors(noise={"y": 0.1})
    errors = [sensed.measured(1, k, 1.5, x)[4] - x[4] for k in range(2000)]
    again = [sensed.measured(1, k, 1.5, x)[4] - x[4] for k in range(2000)]
    assert errors == again
    assert np.std(errors) == pytest.approx(0.1, rel=0.1)
