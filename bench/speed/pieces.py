"""Measure what each piece of an in-process step takes.

    phalanx compile unicycles && python bench/speed/pieces.py unicycles radio

Each piece is timed with all that it calls, less the pieces in it; as a share of the run, since a
clock around every call slows a run down. The CPU time of a step is of runs without clocks.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from phalanx_agent.controller import DistributedController
from phalanx_agent.step import ControlStep
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.judge.judge import Judge
from phalanx_plant.observers.recorder import Recorder, TrajectoryHash
from phalanx_plant.sampling.sampling import Sampling
from phalanx_plant.sampling.sensing import Sensing
from phalanx_plant.world.world import World

import phalanx
from phalanx.knowledge.own_parts import OwnParts
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.swarm.radio import PeerKnowledge
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows
from phalanx.theory.laws.law import CheckedInput
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.safety_filter import ComposedFilter, PairwiseFilter

PIECES: dict[str, list[tuple[type, str]]] = {
    "integration": [(World, "advance")],
    "samples": [(Sampling, "take"), (Sensing, "visible")],
    "inbox and fates": [(ControlStep, "_decide_fates")],
    "sample and messages": [(ControlStep, "accept_sample"), (ControlStep, "_answer")],
    "terms and goal": [(DistributedController, "_view")],
    "law": [(CheckedInput, "__call__")],
    "knowledge by radio": [(PeerKnowledge, "__call__"), (OwnParts, "__call__")],
    "row": [(ComposedFilter, "__call__"), (PairwiseFilter, "__call__")],
    "QP": [(NearestInput, "solve"), (NearestInput, "least_violation")],
    "h, ψ and defects": [(Judge, "_add")],
    "certificates": [(Coverage, "proven")],
    "fold of the judge": [(Judge, "judge")],
    "hash and records": [(TrajectoryHash, "add"), (Recorder, "record")],
}
_RUNS = 6


class Stopwatch:
    """Time of each piece, less that of pieces within."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        self._inner = [0.0]

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with a clock around it."""

        def timed(*values: Any, **named: Any) -> Any:
            self._inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*values, **named)
            finally:
                took = time.perf_counter() - began
                self.seconds[name] += took - self._inner.pop()
                self._inner[-1] += took

        return timed


def main() -> None:
    """Print a table for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenarios", nargs="+")
    parser.add_argument("--duration", type=float, default=3.0, help="of each run [s]")
    options = parser.parse_args()
    every = [
        shared_rows(phalanx.load(name, {"duration": options.duration}))
        for name in options.scenarios
    ]
    steps = [min(cpu_time(rows) for _ in range(_RUNS)) for rows in every]
    watch = Stopwatch()
    for name, methods in PIECES.items():
        for owner, method in methods:
            setattr(owner, method, watch.around(name, getattr(owner, method)))
    for scenario, rows, step in zip(options.scenarios, every, steps, strict=True):
        runs = [watched(rows, watch) for _ in range(_RUNS)]
        # The least of each: whatever else the machine does lands in some piece of some run.
        least = {name: min(run[name] for run in runs) for name in runs[0]}
        print(f"\n| {scenario} | share | of {1e6 * step:.0f} µs |\n|---|---|---|")
        for name, seconds in sorted(least.items(), key=lambda item: -item[1]):
            share = seconds / sum(least.values())
            print(f"| {name} | {share:.1%} | {1e6 * step * share:.0f} |")


def watched(rows: SafetyRows, watch: Stopwatch) -> dict[str, float]:
    """Return the time of each piece in a run [s]."""
    watch.seconds.clear()
    began = time.perf_counter()
    Simulation(rows, RecordsInMemory()).run()
    rest = time.perf_counter() - began - sum(watch.seconds.values())
    return {**watch.seconds, "schedule, queues and the rest": rest}


def cpu_time(rows: SafetyRows) -> float:
    """Return the CPU time of a step in a run [s]."""
    began = time.process_time()
    steps = Simulation(rows, RecordsInMemory()).run().steps
    return (time.process_time() - began) / steps


if __name__ == "__main__":
    main()
