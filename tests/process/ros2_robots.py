"""Five ROS 2 robots, each a process of its own, and a run with them in real time."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from subprocess import PIPE

import phalanx
from phalanx.wire.session import open_hub, reserved_endpoint

ROBOT = Path(__file__).parents[2] / "examples" / "ros2_robots" / "robot.py"
CUT = "3"
"""The agent whose inputs are cut."""


@contextlib.contextmanager
def robots(
    scenario: phalanx.Scenario,
    router: str,
    options: Mapping[str, Sequence[str]],
    last_lines: dict[str, dict[str, float]],
) -> Iterator[None]:
    """Run a robot for each agent; at the end last_lines has the last line of each."""
    running: dict[str, subprocess.Popen[str]] = {}
    with contextlib.ExitStack() as stack:
        for name, group, index in scenario.roster():
            pose = map(str, group.start[index])
            command = [
                sys.executable,
                str(ROBOT),
                router,
                name,
                *options.get(name, ()),
                "--",
                *pose,
            ]
            robot = subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True)
            running[name] = stack.enter_context(robot)
            stack.callback(running[name].kill)
        for robot in running.values():
            assert robot.stdout
            assert robot.stdout.readline() == "ready\n"
        yield
        for name, robot in running.items():
            output, _ = robot.communicate(timeout=30)
            last_lines[name] = json.loads(output.splitlines()[-1])


def run_with_robots(
    seconds: float,
    cut: float,
    out: Path,
    options: Mapping[str, Sequence[str]],
    overrides: Sequence[str] = (),
) -> tuple[phalanx.Run, dict[str, dict[str, float]]]:
    """Run the robots to a verdict; cut: when agent CUT is paused for 2 s [s]."""
    last_lines: dict[str, dict[str, float]] = {}
    with reserved_endpoint() as router, open_hub(router):
        fault = f'faults=[{{ kind = "pause", agents = ["{CUT}"], at = {cut}, for = 2.0 }}]'
        settings = [f"duration={seconds}", f'world.router="{router}"', *overrides]
        settings += [fault] if cut < seconds else []
        scenario = phalanx.load("worlds/ros2-robots", settings)
        with robots(scenario, router, options, last_lines):
            finished = phalanx.run(scenario, out=out, real_time=1.0)
    return finished, last_lines
