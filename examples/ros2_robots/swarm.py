"""Start a robot for each agent of a scenario of the world `ros2`, and the router where they meet.

pip install ./packages/phalanx-ros2 pycdr2
python examples/ros2_robots/swarm.py [SCENARIO] [FIELD=VALUE ...], until Ctrl-C; in another terminal
phalanx run worlds/ros2-robots --real-time --set duration=20
"""

import json
import signal
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

import zenoh

import phalanx

ROBOT = Path(__file__).with_name("robot.py")
PIPE = subprocess.PIPE


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    name, *fields = sys.argv[1:] or ["worlds/ros2-robots"]
    scenario = phalanx.load(name, fields)
    router = scenario.world["router"]
    config = {"mode": "router", "listen": {"endpoints": [router]}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))), ExitStack() as stack:
        robots = []
        for agent, group, member in scenario.roster():
            start = [str(number) for number in group.start[member]]
            command = [sys.executable, ROBOT, router, agent, "--", *start]
            # In a session of its own, which Ctrl-C does not reach: it ends when its input closes.
            robot = subprocess.Popen(
                command, stdin=PIPE, stdout=PIPE, text=True, start_new_session=True
            )
            robots.append((agent, stack.enter_context(robot)))
        for _, robot in robots:
            robot.stdout.readline()
        print(f"{len(robots)} robots at {router}; Ctrl-C ends them", flush=True)
        with suppress(KeyboardInterrupt):
            signal.pause()
        for agent, robot in robots:
            last, _ = robot.communicate()
            print(f"robot {agent}: {last.strip()}", flush=True)


if __name__ == "__main__":
    main()
