"""Measure the CPU time of a step with and without `safety.keep`, in turns, by the swarm's size.

    python bench/speed/promise.py [swarm2d] [--agents 8,32,128] [--rounds 5]

Of whole runs in this process, agents and judge, from .1 s on; the least of the rounds counts.
Compile the sizes first: phalanx compile swarm2d --set agents.0.count=28 --set agents.1.count=4.
"""

import argparse
import time

import phalanx
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows

STEPS = 500
"""About so many in a run."""


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenario", nargs="?", default="swarm2d")
    parser.add_argument("--agents", default="8,32,128", help="sizes; one in eight an adversary")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print("| agents | step [µs] | with `keep` | ratio |\n|---|---|---|---|")
    for count in map(int, options.agents.split(",")):
        sizes = {"agents.0.count": count - count // 8, "agents.1.count": count // 8}
        duration = {"duration": 0.1 + STEPS * 0.07 / count}
        cases = [
            shared_rows(phalanx.load(options.scenario, sizes | duration | {"safety.keep": keep}))
            for keep in (None, "hold")
        ]
        rounds = [[cpu_time(rows) for rows in cases] for _ in range(options.rounds)]
        without, kept = (1e6 * min(times) for times in zip(*rounds, strict=True))
        print(f"| {count} | {without:.0f} | {kept:.0f} | {kept / without:.2f} |", flush=True)


def cpu_time(rows: SafetyRows) -> float:
    """Return the CPU time of a step in a run [s]."""
    simulation = Simulation(rows, RecordsInMemory())
    simulation.advance(0.1)
    before, began = simulation.plant.judge.findings().steps, time.process_time()
    simulation.advance()
    took = time.process_time() - began
    assert simulation.summary is not None
    return took / (simulation.summary.steps - before)


if __name__ == "__main__":
    main()
