"""Run five ROS 2 robots in real time, each a process of an independent client; print the outcome.

python evidence/worlds/ros2_robots.py [--seconds 60] [--cut 30]

Robots lose 10 % of odometry and velocities and delay odometry by 20 ms; broadcasts lose 10 % too.
From --cut on agent 3 is paused for 2 s: its robot gets no input, and has to be commanded to stop.
"""

import argparse
import tempfile
from pathlib import Path

from tests.process.ros2_robots import run_with_robots


def main() -> None:
    """Print verdict, assumptions, latencies and firings of the watchdog."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cut", type=float, default=30.0)
    given = parser.parse_args()
    options = dict.fromkeys("12345", ("--loss", "0.1", "--delay", "0.02"))
    with tempfile.TemporaryDirectory() as folder:
        finished, found = run_with_robots(given.seconds, given.cut, Path(folder), options)
        summary = finished.summary
        assert summary
        print(
            f"verdict: {summary.outcome}: {summary.reason}; largest h_tot {summary.worst_h_tot:.3f}"
        )
        for each in summary.assumptions:
            print(f"  {each.name}: {each.failed} of {each.checked} failed")
        assert summary.punctuality
        for times in summary.punctuality.measured:
            print(f"  {times}")
        print(
            *(f"  {e['t']:.3f} s {e['text']}" for e in finished.events.iter_rows(named=True)),
            sep="\n",
        )
        print(*(f"  robot {name}: {last}" for name, last in found.items()), sep="\n")


if __name__ == "__main__":
    main()
