"""Wheeled robots with mass in MuJoCo, as a world; and what the verdict makes of their failures."""

import numpy as np
import pytest
from phalanx_testing import check_world
from phalanx_worlds.mujoco import Failure, Mujoco

import phalanx
from phalanx.extend import (
    DifferentialDrive,
    DynamicUnicycle,
    SingleIntegrator,
    Unicycle,
    WorldAgent,
)
from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.guarantee.verdict import Outcome

HEAVY = DynamicUnicycle(4.0, 8.0, drag=1.0, turn_drag=4.0)
LIGHT = Unicycle(4.0, 2.0)
START = np.array([1.0, 2.0, 7.0, 0.5, -0.3])
DYNAMICS = [HEAVY, LIGHT, DifferentialDrive(20.0, 0.1, 0.4)]


def robots(dynamics, start=START):
    n = len(dynamics.states)
    return [WorldAgent(name, dynamics, start[:n] + 3.0 * k) for k, name in enumerate(("1", "2"))]


def driven(u, until, world=None, dynamics=HEAVY, start=START):
    """The states of robot 1, and the world's notes."""
    world = world or Mujoco()
    world.begin(robots(dynamics, start), 0, 1e-3)
    world.hold("1", np.array(u))
    states = world.advance(until)
    return states.x["1"], states.notes


def needed(x, u, dynamics=HEAVY):
    """The disturbance that explains each millisecond."""
    given = np.broadcast_to(u, (len(x) - 1, 2)), np.full(len(x) - 1, 1e-3)
    return DisturbanceLedger(dynamics).explain(x[:-1], x[1:], *given).size


@pytest.mark.parametrize("dynamics", DYNAMICS, ids=lambda model: type(model).__name__)
def test_robots_keep_the_rules_of_a_world(dynamics):
    check_world(Mujoco, robots(dynamics))


def test_a_failure_between_two_instants_divides_the_motion_as_an_advance_does():
    failure = Failure(at=0.02, agent="1", mass=2.0, wheel="left")
    check_world(lambda: Mujoco(failures=(failure,)), robots(HEAVY))


def test_a_robot_starts_where_it_is_put_with_its_speeds():
    first = driven([0.0, 0.0], 1e-3)[0][0]
    np.testing.assert_allclose(first, START, atol=2e-3)


def test_a_robot_accelerates_as_declared():
    u = np.array([3.0, -4.0])
    x, _ = driven(u, 1.0)
    assert needed(x, u).max() < 0.1
    assert x[-1, 3] > 1.5


def test_the_heading_does_not_jump_in_a_full_turn():
    x, _ = driven([0.0, 8.0], 5.0)
    assert abs(x[-1, 2] - x[0, 2]) > 2.0 * np.pi
    assert np.abs(np.diff(x[:, 2])).max() < 0.01


def test_a_speed_is_reached_but_does_not_jump():
    x, _ = driven([2.0, 1.0], 2.0, dynamics=LIGHT)
    speeds = np.linalg.norm(np.diff(x[:, :2], axis=0), axis=1) / 1e-3
    assert speeds[0] < 0.2
    assert speeds[-1] == pytest.approx(2.0, abs=0.01)
    assert needed(x, [2.0, 1.0], LIGHT).max() > 1.5


def test_wheels_slip_on_ice():
    u = np.array([4.0, 0.0])
    assert np.median(needed(driven(u, 0.5, Mujoco(friction=0.1))[0], u)) > 1.0


def test_robots_that_meet_push_each_other():
    towards = np.array([[0.0, 0.0, 0.0, 2.0, 0.0], [2.0, 0.0, np.pi, 2.0, 0.0]])
    world = Mujoco()
    world.begin([WorldAgent(str(k), HEAVY, x) for k, x in enumerate(towards)], 0, 1e-3)
    states = world.advance(1.0)
    distance = np.linalg.norm(states.x["0"][:, :2] - states.x["1"][:, :2], axis=1)
    assert 0.45 < distance.min() < 0.55


@pytest.mark.parametrize(
    ("failure", "text"),
    [
        (Failure(at=0.2, agent="1", mass=2.0), "agent 1: mass times 2"),
        (Failure(at=0.2, agent="1", wheel="left"), "agent 1: left wheel stuck"),
    ],
    ids=["mass", "wheel"],
)
def test_what_fails_is_noted_and_needs_a_disturbance_from_then_on(failure, text):
    u = np.array([3.0, 0.0])
    x, notes = driven(u, 0.5, Mujoco(failures=(failure,)))
    assert [(note.t, note.text, note.fails) for note in notes] == [(0.2, text, "")]
    size = needed(x, u)
    assert size[:199].max() < 0.1
    assert size[200:].max() > 0.5


def test_robots_with_other_coordinates_are_refused():
    with pytest.raises(ValueError, match="agent one: expected dynamics with states of dynamic-"):
        Mujoco().require_robots({"one": SingleIntegrator(1.0)})


def test_a_failure_of_no_agent_is_refused():
    with pytest.raises(ValueError, match="failures: expected names of agents, got 9"):
        Mujoco(failures=(Failure(at=1.0, agent="9"),)).require_robots({"one": HEAVY})


@pytest.mark.slow
@pytest.mark.parametrize(
    "failure",
    [
        pytest.param("mass = 2.0", id="mass"),
        pytest.param('wheel = "left"', id="wheel", marks=pytest.mark.nightly),
        pytest.param("mass = 1.0", id="nothing", marks=pytest.mark.nightly),
    ],
)
def test_a_run_in_which_a_robot_fails_is_not_guaranteed_and_says_why(failure, tmp_path):
    table = f'world={{ type = "mujoco", failures = [{{ at = 0.5, agent = "1", {failure} }}] }}'
    scenario = phalanx.load("worlds/rovers", ["duration=1.0", table])
    summary = phalanx.run(scenario, engine="in-process", out=tmp_path).summary
    failed = {a.name: a.first for a in summary.assumptions if a.failed}
    if failure == "mass = 1.0":
        assert summary.outcome is Outcome.GUARANTEED
    else:
        assert summary.outcome is not Outcome.GUARANTEED
        assert failed["disturbance bound"] == pytest.approx(0.5, abs=0.2)
        assert failed["disturbance bound"] >= 0.5
        assert "disturbance bound" in summary.reason
