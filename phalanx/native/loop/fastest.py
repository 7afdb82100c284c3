"""The fastest engine for a run: native where that is possible and pays, else in process."""

import logging
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from phalanx_plant.observers.track import TrackKeeper

from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import RunOptions
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.native.library import generation
from phalanx.native.loop.eligible import reason_against
from phalanx.native.loop.engine import (
    IN_PROCESS,
    NATIVE,
    CompiledRun,
    LoopError,
    NativeSimulation,
    compiled_rows,
    compiled_run,
    run_or_else,
)
from phalanx.recording.columns import Track
from phalanx.recording.metrics.measures import track_of
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import compiled_fields
from phalanx.theory.arrays import Array

log = logging.getLogger("phalanx.native")
_WORTH = 2.0
"""CPU time of runs in process after which their functions are compiled: about that of a compiler
[s]."""
_spent = defaultdict[str, float](float)
"""By the fields that functions depend on, the CPU time of runs in process [s]."""
_lacking = dict[str, int]()
"""By these fields, the generation of functions in which some were not compiled."""


class Finished(NamedTuple):
    """A run without files, at its verdict."""

    summary: Summary
    track: Track
    least: Array
    """The least time that was left of each pair's certificate [s], shape (p,)."""
    engine: str
    """The engine that made it."""


def finish(rows: SafetyRows) -> Finished:
    """Run to the verdict, without files."""
    run, swarm = _ready(rows), rows.swarm
    if run is not None:
        keeper = TrackKeeper(swarm)
        simulation: Simulation = NativeSimulation(run, None, keeper=keeper)
        try:
            summary = simulation.run()
            track = keeper.track(summary.deadlocks)
            return Finished(summary, track, simulation.plant.judge.coverage.least, NATIVE)
        except LoopError as error:
            log.info("in process, not native: %s", error)
            rows = shared_rows(swarm.scenario)
    records = RecordsInMemory()
    simulation = Simulation(rows, records)
    with _counted(swarm.scenario):
        summary = simulation.run()
    track = track_of(records.recording(swarm.scenario, summary), swarm)
    return Finished(summary, track, simulation.plant.judge.coverage.least, IN_PROCESS)


def run_fastest(
    scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions
) -> Summary:
    """Run a scenario to its verdict, as an Engine."""
    run = None if options.commands.schedule else _ready(shared_rows(scenario))
    with _counted(scenario, run is None):
        return run_or_else(run, scenario, make_folder, options)


@contextmanager
def _counted(scenario: Scenario, counts: bool = True) -> Iterator[None]:
    """Add the CPU time of the block to that of runs in process, if it counts."""
    began = time.process_time()
    yield
    _spent[compiled_fields(scenario)] += (time.process_time() - began) * counts


def _ready(rows: SafetyRows) -> CompiledRun | None:
    """Return a run that the loop can make; None if it cannot, or if compiling does not pay yet."""
    if reason_against(rows):
        return None
    scenario = rows.swarm.scenario
    fields = compiled_fields(scenario)
    if _spent[fields] > _WORTH:
        _spent[fields] = float("-inf")  # once
        try:
            compiled_rows(scenario)
        except OSError as error:
            log.info("in process, not native: %s", error)
            return None
        rows = shared_rows(scenario)
    if _lacking.get(fields) == generation():
        return None
    run = compiled_run(rows)
    if run is None:
        _lacking[fields] = generation()
    return run
