"""Compare a control step of examples/programs/cart.py over stdio with that of the law inside.

    python bench/speed/program_step.py

Runs alternate, and have the same bits. A step is from sample to input, with the filter in both.
"""

import argparse
import os
import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import phalanx
from phalanx.extend import Array, TrackVelocity, View

PROGRAMS = Path(__file__).parents[2] / "examples" / "programs"
sys.path.append(str(PROGRAMS.parents[1]))
from examples.programs.cart import wheels  # noqa: E402 - no package has it


@dataclass
class Cart(TrackVelocity):
    """The law of the program."""

    def input(self, view: View) -> Array:
        goal = {name: vector.tolist() for name, vector in view.goal._asdict().items()}
        return np.array(wheels(view.x[view.i].tolist(), goal))


def main() -> None:
    """Run both in turns, and print percentiles of the steps of carts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--duration", type=float, default=4.0, help="of each run [s]")
    options = parser.parse_args()
    cases: dict[str, dict[str, object]] = {
        "inside": {"agents.0.law": Cart()},
        "over stdio": {
            "agents.0.program": [sys.executable, str(PROGRAMS / "cart.py")],
            "agents.0.filter": True,
        },
    }
    times, bits = defaultdict[str, list[float]](list), set[str]()
    for _ in range(options.turns):
        for name, fields in cases.items():
            scenario = phalanx.load("warehouse", {**fields, "duration": options.duration})
            run = phalanx.run(scenario, engine="in-process")
            assert run.summary is not None
            bits.add(run.summary.trajectory)
            steps = (s for s in run.recording.steps if s.agent.startswith("cart-") and s.k > 0)
            times[name] += [1e6 * step.solve_time for step in steps]
    assert len(bits) == 1, "the program has the bits of the law"
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs")
    print("| | steps | p50 | p90 | p99 [µs] |\n|---|---|---|---|---|")
    for name, values in times.items():
        p50, p90, p99 = np.percentile(values, [50, 90, 99])
        print(f"| {name} | {len(values)} | {p50:.0f} | {p90:.0f} | {p99:.0f} |")


if __name__ == "__main__":
    main()
