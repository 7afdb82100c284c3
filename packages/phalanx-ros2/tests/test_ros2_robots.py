"""Robots of an independent ROS 2 client, each a process of its own, in real time."""

import signal
import subprocess
import sys
from dataclasses import replace

import pytest
from phalanx_ros2.world import Ros2
from phalanx_testing import check_world

import phalanx
from phalanx.extend import WorldAgent
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.session import open_hub, reserved_endpoint
from tests.process.ros2_robots import CUT, ROBOT, robots, run_with_robots

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


def events_with(run, text):
    return [line for line in run.events["text"] if text in line]


def test_robots_move_as_commanded_and_one_without_inputs_is_stopped(tmp_path):
    run, robots = run_with_robots(5.0, 1.5, tmp_path, {"1": ("--delay", "0.02")})
    assert events_with(run, f"agent {CUT}: no input for 0.4 s, commanded to stop")
    assert all(robot["taken"] > 30 for robot in robots.values())
    assert robots[CUT]["zeros"] > 10
    assert all(robot["v"] == robot["w"] == 0.0 for robot in robots.values()), "stopped at the end"
    # On busy cores inputs are late, and robots stand still for most of the run.
    step = run.scenario.world["command_period"] * run.scenario.agents[0].dynamics["speed"]
    for name, direction in (("1", 1.0), ("2", -1.0)):
        commands = robots[name]["taken"] - robots[name]["zeros"]
        x = run.states[f"{name}.x"]
        assert direction * (x[-1] - x[0]) > 0.25 * step * commands > 0.0


def test_robots_over_ros2_keep_the_rules_of_a_world_but_for_determinism():
    scenario = phalanx.load("worlds/ros2-robots")
    swarm = build_swarm(scenario)
    starts = (swarm.start()[part] for part in swarm.safe_set.parts)
    agents = [WorldAgent(m.name, m.dynamics, x) for m, x in zip(swarm.members, starts, strict=True)]
    with reserved_endpoint() as router, open_hub(router), robots(scenario, router, {}, {}):
        # Robots are not put back between two worlds, so poses must not draw them much; and on busy
        # cores an input may be late.
        near = Ros2(
            router=router,
            start_tolerance=1.0,
            input_timeout=60.0,
            odometry_timeout=60.0,
            blend=10.0,
            command_period=0.02,
        )
        check_world(lambda: replace(near), agents)


def test_the_robots_of_the_example_serve_a_run_and_end_by_ctrl_c(tmp_path):
    command = [sys.executable, ROBOT.with_name("swarm.py"), "worlds/ros2-robots"]
    with reserved_endpoint() as router:
        at = f'world.router="{router}"'
        with subprocess.Popen([*command, at], stdout=subprocess.PIPE, text=True) as swarm:
            try:
                assert swarm.stdout.readline() == f"5 robots at {router}; Ctrl-C ends them\n"
                scenario = phalanx.load("worlds/ros2-robots", [at, "duration=2.0"])
                run = phalanx.run(scenario, out=tmp_path, real_time=1.0)
            finally:
                swarm.send_signal(signal.SIGINT)
                lines = swarm.communicate(timeout=60)[0].splitlines()
    assert run.verdict in ("guaranteed", "safe")
    assert [line.partition(":")[0] for line in lines] == [f"robot {n}" for n in "12345"]
    assert not any('"taken": 0' in line for line in lines)


def test_a_robot_whose_odometry_ends_fails_an_assumption_by_its_name(tmp_path):
    run, _ = run_with_robots(4.0, 9.0, tmp_path, {"2": ("--silent-after", "30")})
    assert run.verdict != "guaranteed"
    assert "odometry of agent 2" in {a.name for a in run.summary.assumptions}


def test_a_dry_run_sends_robots_nothing_and_says_so(tmp_path):
    run, robots = run_with_robots(2.0, 9.0, tmp_path, {}, ["world.dry_run=true"])
    assert [robot["taken"] for robot in robots.values()] == [0] * 5
    assert "commands sent" in {a.name for a in run.summary.assumptions}
    assert len(run.inputs) > 0
