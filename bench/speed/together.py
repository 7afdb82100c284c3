"""Compare several agents in a process with one each: start-up, memory, time of a step.

    python bench/speed/together.py [swarm] [--agents 64,128] [--together 1,8] [--rounds 3]

The kinds alternate, round by round. Start-up is from the call until all agents have joined, memory
the PSS of plant and agents once they have, RTF the real-time factor; each a median, steps with
the least and the largest of the rounds.
"""

import argparse
import statistics
import threading
import time
from queue import SimpleQueue
from typing import NamedTuple

import psutil
from scale import megabytes, sized

import phalanx
from phalanx.messages.kinds import Status


class Measured(NamedTuple):
    """One run."""

    startup: float
    """[s]"""
    memory: float
    """PSS of all programs [MB]."""
    step: float
    """Wall time of one agent step [s]."""
    factor: float
    trajectory: str


def main() -> None:
    """Measure every size and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenario", nargs="?", default="swarm")
    arguments.add_argument("--agents", default="64,128")
    arguments.add_argument("--together", default="1,8", help="agents in a process")
    arguments.add_argument("--steps", type=int, default=4000, help="of all agents in a run")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    kinds = [int(many) for many in options.together.split(",")]
    print("| N | in a process | start-up [s] | memory [MB] | step [µs] | RTF | trajectory |")
    print("|---|---|---|---|---|---|---|")
    for size in map(int, options.agents.split(",")):
        scenario = sized(options.scenario, size, options.steps)
        rounds = [[observed(scenario, many) for many in kinds] for _ in range(options.rounds)]
        same = len({run.trajectory for each in rounds for run in each}) == 1
        for many, runs in zip(kinds, zip(*rounds, strict=True), strict=True):
            startup, memory, step, factor = (
                statistics.median(run[k] for run in runs) for k in range(4)
            )
            spread = "-".join(f"{1e6 * f(run.step for run in runs):.0f}" for f in (min, max))
            cells = f"{startup:.2f} | {memory:.0f} | {1e6 * step:.0f} ({spread}) | {factor:.2f}"
            print(f"| {size} | {many} | {cells} | {'same' if same else 'DIFFERENT'} |", flush=True)


def observed(scenario: phalanx.Scenario, together: int) -> Measured:
    """Run a scenario with real processes, and measure them once all have joined."""
    joined: SimpleQueue[float] = SimpleQueue()
    measurements: list[tuple[float, float]] = []

    def on_status(status: Status) -> None:
        if not status.waiting_for:
            joined.put(time.perf_counter())

    def look() -> None:
        seconds = joined.get() - began
        children = psutil.Process().children(recursive=True)
        measurements.append(
            (seconds, sum(megabytes(p) for p in children if p.name().startswith("phx-")))
        )

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    began = time.perf_counter()
    summary = phalanx.run(scenario, progress=on_status, agents_per_process=together).summary
    assert summary is not None
    watcher.join()
    step = summary.wall_time / summary.steps
    return Measured(*measurements[0], step, summary.real_time_factor, summary.trajectory)


if __name__ == "__main__":
    main()
