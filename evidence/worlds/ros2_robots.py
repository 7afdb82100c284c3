"""Run five ROS 2 robots in real time, each a process of an independent client; print the outcomes.

    chrt -f 10 python evidence/worlds/ros2_robots.py

Robots lose 10 % of odometry and velocities and delay odometry by 20 ms; broadcasts lose 10 % too.
In a second run agent 3 is paused for 2 s: its robot gets no input, and has to be commanded to stop.
`chrt -f` lets these programs go before all others, on a machine that is busy; it needs a privilege.
"""

import argparse
import math
import os
import tempfile
from pathlib import Path

import numpy as np

import phalanx
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import swarm_of
from tests.process.ros2_robots import run_with_robots

SCHEDULING = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "first in, first out", os.SCHED_RR: "in turn"}


def main() -> None:
    """Print both runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--set", metavar="FIELD=VALUE", action="append", default=[])
    arguments = parser.parse_args()
    for title, cut in {"no pause": math.inf, "agent 3 paused": arguments.seconds / 2}.items():
        options = dict.fromkeys("12345", ("--loss", "0.1", "--delay", "0.02"))
        policy = SCHEDULING.get(os.sched_getscheduler(0), "another")
        print(f"{title}: {os.cpu_count()} cores, load {os.getloadavg()[0]:.0f}, scheduled {policy}")
        with tempfile.TemporaryDirectory() as folder:
            show(*run_with_robots(arguments.seconds, cut, Path(folder), options, arguments.set))


def show(run: phalanx.Run, robots: dict[str, dict[str, float]]) -> None:
    """Print verdict, assumptions, latencies, disturbances, events, and what robots were sent."""
    summary = run.summary
    assert summary
    assert summary.punctuality
    print(f"  {summary.outcome}: largest h_tot {summary.largest_h_tot:.3f}")
    for checked in summary.assumptions:
        note = f"; {checked.note}" if checked.failed else ""
        print(f"    {checked.name}: {checked.failed} of {checked.checked} failed{note}")
    for latency in summary.punctuality.measured:
        p50, p99, most = (f"{1e3 * t:.2f}" for t in (latency.p50, latency.p99, latency.most))
        print(f"    {latency.name} [ms]: p50 {p50}, p99 {p99}, largest {most}, of {latency.count}")
    sizes = [each.size for each in disturbances_of(run.recording, swarm_of(run.recording))]
    for name, size in zip(robots, sizes, strict=True):
        p50, p99, most = (f"{value:.3f}" for value in (*np.quantile(size, [0.5, 0.99]), size.max()))
        print(f"    agent {name}, disturbance needed: p50 {p50}, p99 {p99}, largest {most}")
    for event in run.events.iter_rows(named=True):
        print(f"    {event['t']:.3f} s {event['text']}")
    for name, last in robots.items():
        print(f"    robot {name}: {last['taken']} velocities, {last['zeros']} of them zero")


if __name__ == "__main__":
    main()
