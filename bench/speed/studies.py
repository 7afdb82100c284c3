"""Compare a study with a run each: CPU time for a row, workers, and the coordinator's own share.

    python bench/speed/studies.py --runs 40

Each round measures all in turn, so that a machine that is busy slows down all of them.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

import psutil
from phalanx_studies.pool import Pool
from phalanx_studies.study import study

import phalanx


def main() -> None:
    """Print the ratios."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--scenario", default="unicycles")
    arguments.add_argument("--duration", type=float, default=3.0, help="virtual time [s]")
    arguments.add_argument("--runs", type=int, default=20, help="of each round")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    scenario = phalanx.load(options.scenario, {"duration": options.duration})
    run_times, rows, coordinator, scaling = [], [], [], []
    for number in range(options.rounds):
        first = number * options.runs
        seeds = range(first, first + options.runs)
        run_times.append(by_run(scenario, seeds))
        one = by_study(scenario, seeds, 1)
        two = by_study(scenario, seeds, 2)
        rows.append(one[1])
        coordinator.append(two[0] / two[1])
        scaling.append(one[2] / two[2])
    runs = options.runs
    print(
        f"{options.scenario}, {options.rounds} rounds of {runs} runs, {os.cpu_count()} processors"
    )
    print(f"a run and its metrics:  {statistics.median(run_times) / runs:.3f} s of CPU")
    print(f"a row of a study:       {statistics.median(rows) / runs:.3f} s of CPU")
    ratios = [a / b for a, b in zip(run_times, rows, strict=True)]
    spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
    print(f"rows for the CPU of a run: {statistics.median(ratios):.2f} ({spread})")
    print(f"two workers are {statistics.median(scaling):.2f} times as fast as one")
    print(f"the coordinator takes {statistics.median(coordinator):.2%} of the workers' CPU")


def by_run(scenario: phalanx.Scenario, seeds: range) -> float:
    """Return the CPU time of a run and its metrics for each seed, in this process [s]."""
    began = time.process_time()
    for seed in seeds:
        seeded = scenario.model_copy(update={"seed": seed})
        run = phalanx.run(seeded, engine="in-process")
        assert len(run.metrics)
    return time.process_time() - began


def by_study(scenario: phalanx.Scenario, seeds: range, workers: int) -> tuple[float, float, float]:
    """Return the CPU time of the coordinator and of its workers, and the wall time [s]."""
    with Pool(workers) as pool, tempfile.TemporaryDirectory() as folder:
        # Each worker loads and compiles once for thousands of rows.
        study(scenario, seeds=2 * workers, executor=pool, in_flight=2 * workers)
        coordinator, others, wall = time.process_time(), of_workers(), time.monotonic()
        out = Path(folder)
        study(scenario, seeds=seeds, out=out, executor=pool, in_flight=2 * workers)
        return time.process_time() - coordinator, of_workers() - others, time.monotonic() - wall


def of_workers() -> float:
    """Return the CPU time of all processes that this one has started, directly or not [s]."""
    children = psutil.Process().children(recursive=True)
    return sum(sum(child.cpu_times()[:2]) for child in children)


if __name__ == "__main__":
    main()
