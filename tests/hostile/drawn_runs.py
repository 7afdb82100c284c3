"""Runs of scenarios drawn at random, in C and in Python: both must give the same to the bit.

`python -m tests.hostile.drawn_runs 200 --first 0`: as many, from that seed on, and what became of
those that differ or are no runs. Formulas, QP and backup are compiled in the first and interpreted
in the other.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any
from unittest.mock import patch

import msgspec

from phalanx.launcher.engine import RunOptions
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.native import library
from phalanx.native.loop.eligible import reason_against
from phalanx.native.loop.engine import LoopError, NativeSimulation, compiled_rows, compiled_run
from phalanx.recording.records import Log, State, Step
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.runnable import require_runnable, shared_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.cache import FunctionCache
from tests.hostile.drawn_scenarios import FAMILY, scenario_of

Run = tuple[dict[str, Any], RecordsInMemory]


def in_c(scenario: Scenario) -> Run:
    """A run's summary and records by the loop in C. Raises LoopError."""
    records = RecordsInMemory()
    run = compiled_run(shared_rows(scenario)) or compiled_run(compiled_rows(scenario))
    assert run is not None
    return _results(NativeSimulation(run, records, RunOptions("native")), records)


def in_process(scenario: Scenario, functions: FunctionCache | None = None) -> Run:
    """The same in process. functions: of scenarios with the same ones."""
    records = RecordsInMemory()
    rows = require_runnable(build_swarm(scenario, functions))
    return _results(Simulation(rows, records), records)


def _results(simulation: Simulation, records: RecordsInMemory) -> Run:
    summary = msgspec.to_builtins(simulation.run())
    del summary["wall_time"]
    for step in records.of(Step):
        step.solve_time = 0.0
    return summary, records


def differences(made: Run, wanted: Run) -> Iterator[str]:
    """The parts in which two runs differ by a bit: verdicts and records."""
    for field, value in wanted[0].items():
        if repr(made[0][field]) != repr(value):
            yield f"{field}: {made[0][field]}, in process {value}"
    for kind in (State, Step, Log):
        rows, others = made[1].of(kind), wanted[1].of(kind)
        if len(rows) != len(others):
            yield f"{len(rows)} {kind.__name__}s, in process {len(others)}"
        pairs = zip(map(repr, rows), map(repr, others), strict=False)
        yield from (f"{a}, in process {b}" for a, b in pairs if a != b)


def compare(seeds: Sequence[int]) -> Iterator[tuple[str, int]]:
    """A comparison of the two runs of each seed of a family, in words, and their control steps."""
    scenarios, made = list[Scenario](), list[Run | str]()
    for seed in seeds:
        try:
            scenario = scenario_of(seed)
            if reason := reason_against(build_rows(build_swarm(scenario))):
                yield f"not eligible: {reason}", 0
                continue
            compiled_rows(scenario) if not scenarios else None
            scenarios.append(scenario)
            made.append(in_c(scenario))
        except ScenarioError as error:
            yield f"no run: {error}", 0
        except LoopError as error:
            made.append(str(error))
    functions = FunctionCache()
    library._begin_generation()
    with patch.object(library, "_folder", lambda: None):
        for scenario, run in zip(scenarios, made, strict=True):
            wanted = in_process(scenario, functions)
            if isinstance(run, str):
                yield f"left to Python: {run}; {wanted[0]['outcome']}", 0
                continue
            difference = next(differences(run, wanted), None)
            yield (f"DIFFERENT: {difference}" if difference else "equal"), wanted[0]["steps"]
    library._begin_generation()


def main() -> int:
    """Compare runs; return the number of those that differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=int)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    outcomes, steps, began = Counter[str](), 0, time.process_time()
    seeds = range(arguments.first, arguments.first + arguments.runs)
    for family, members in groupby(seeds, lambda seed: seed // FAMILY):
        for result, made in compare(list(members)):
            steps += made
            outcomes[result.partition(":")[0]] += 1
            if result != "equal":
                print(f"family {family}: {result[:1000]}", flush=True)
    seconds = time.process_time() - began
    print(f"{dict(outcomes)}, {steps} control steps, {seconds:.0f} s of CPU time")
    return outcomes["DIFFERENT"]


if __name__ == "__main__":
    sys.exit(main())
