"""Odometry in a scenario's coordinates, and what the world of robots refuses."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import pytest
from phalanx_ros2.cdr import message_type
from phalanx_ros2.robots import Odometry, Reading, Twist, reading_of
from phalanx_ros2.world import Ros2, _Held, _Robot

import phalanx
from examples.ros2_robots import robot
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import DynamicUnicycle, Unicycle
from phalanx.theory.models.world import WorldAgent

HOME = robot.Pose(robot.Vector3(2.0, 0.0), robot.Quaternion(0.0, 0.0, 0.0, 1.0))


def odometry(frame="odom"):
    none = [0.0] * 36
    twist = robot.Twist(robot.Vector3(0.5), robot.Vector3())
    return robot.Odometry(
        robot.Header(robot.Time(0, 0), frame),
        "base_link",
        robot.PoseWithCovariance(HOME, none),
        robot.TwistWithCovariance(twist, none),
    )


def test_the_clients_hashes_are_those_of_the_types():
    for kind, name in ((Odometry, robot.ODOMETRY), (Twist, robot.TWIST)):
        assert message_type(kind).on_the_wire == f"{name}/{robot.HASHES[name]}"


def test_odometry_is_turned_and_moved_by_the_origin_of_its_frame():
    reading = reading_of(odometry(), "odom", (1.0, 0.0, math.pi / 2))
    assert reading.pose == pytest.approx([1.0, 2.0, math.pi / 2])
    assert reading.velocity == pytest.approx([0.0, 0.5], abs=1e-12)


def test_odometry_of_another_frame_is_refused():
    with pytest.raises(ValueError, match="expected frame odom, got map"):
        reading_of(odometry("map"), "odom", (0.0, 0.0, 0.0))


def test_robots_need_real_time():
    scenario = phalanx.load("worlds/ros2-robots")
    with pytest.raises(phalanx.EngineError, match="--real-time 1"):
        phalanx.run(scenario, engine="in-process")


@dataclass(frozen=True)
class Renamed(Unicycle):
    """Moves in the plane, by inputs that no command has."""

    inputs = ("v", "w")


OWN = {"type": f"{__name__}:Renamed", "speed": 0.4, "turn_rate": 2.0, "offset": 0.2}


@pytest.mark.parametrize(
    ("scenario", "changes", "message"),
    [
        ("ros2-robots", {"agents.0.dynamics": OWN}, "agent 1: expected unicycle, or single"),
        ("ros2-robots", {"world.robots": {"9": {}}}, "robots: expected names of agents, got 9"),
        ("rovers", {"world.failures": [{"at": 1, "agent": "9"}]}, "failures: expected names of "),
        ("rovers", {"world": {"type": "crazyflies"}}, "agent 1: expected dynamics with states of"),
        ("crazyflies", {"world": {"type": "mujoco"}}, "agent cf-1: expected dynamics with states"),
    ],
)
def test_agents_that_cannot_be_a_worlds_robots_are_refused_when_the_file_is_read(
    scenario, changes, message
):
    with pytest.raises(ScenarioError, match=f"world: {message}"):
        load(f"worlds/{scenario}", changes)


def test_a_field_of_a_world_is_named_by_its_path():
    with pytest.raises(ScenarioError, match=r"robots: world\.robots\.1\.speed: unknown field"):
        load("worlds/ros2-robots", {"world.robots": {"1": {"speed": 1}}})


def test_only_planar_robots_can_be_driven():
    with pytest.raises(ValueError, match="agent car: expected unicycle"):
        Ros2().require_robots({"car": DynamicUnicycle(1.0, 1.0)})


def test_a_velocity_is_commanded_in_the_robots_own_axes():
    robot = _Robot(WorldAgent("a", SingleIntegrator(1.0), np.zeros(2)))
    robot.turn = math.pi / 2
    robot.hold(np.array([0.0, 1.0]))
    assert robot.velocity == pytest.approx([1.0, 0.0, 0.0])


def test_an_acceleration_is_commanded_as_the_velocity_that_it_leads_to():
    robot = _Robot(WorldAgent("a", DoubleIntegrator(1.0, dimension=2), np.zeros(4)))
    robot.hold(np.array([1.0, 0.0]))
    for _ in range(10):
        robot.integrate(0.05)
    assert robot.velocity == pytest.approx([0.5, 0.0, 0.0])
    robot.stop()
    robot.integrate(0.05)
    assert robot.velocity == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("begin", "end", "x"),
    [(10.1, 10.5, [0.1, 0.3]), (10.25, 10.5, [0.0, 0.25]), (10.5, 10.4, [0.0, -0.1])],
    ids=["two inputs", "one input", "a pose that is newer"],
)
def test_a_pose_is_led_on_by_the_inputs_since_then(begin, end, x):
    robot = _Robot(WorldAgent("a", SingleIntegrator(1.0), np.zeros(2)))
    inputs = [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]
    robot.held = deque(map(_Held, (0.0, 10.0, 10.2), map(np.array, inputs)))
    reading = Reading(0.0, np.zeros(3), np.zeros(2))
    assert robot.led(reading, begin, end) == pytest.approx(x)


def test_a_stopped_robot_is_led_on_by_no_input():
    robot = _Robot(WorldAgent("a", SingleIntegrator(1.0), np.zeros(2)))
    robot.hold(np.array([1.0, 0.0]))
    robot.stop()
    since = robot.held[-1].since
    reading = Reading(0.0, np.zeros(3), np.zeros(2))
    assert robot.led(reading, since, since + 1.0) == pytest.approx([0.0, 0.0])
    assert len(robot.held) == 1


def test_clocks_of_robots_that_move_by_the_wall_clock_are_not_perturbed():
    drawn = build_swarm(phalanx.load("worlds/ros2-robots", ["world={ type = 'mujoco' }"])).clock(0)
    real = build_swarm(phalanx.load("worlds/ros2-robots")).clock(0)
    assert real.after(0, 1.0) == pytest.approx(1.1)
    assert drawn.after(0, 1.0) != pytest.approx(1.1)
