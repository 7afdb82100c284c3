"""The native engine: the run in C, and its events judged and recorded as those of any engine."""

import ctypes
import logging
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from phalanx_plant.observers.recorder import RecordSink
from phalanx_plant.observers.track import TrackKeeper
from phalanx_plant.run import PlantRun
from phalanx_plant.world.world import DisturbanceKnot

from phalanx.guarantee.verdict import Summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import RunOptions
from phalanx.launcher.simulation import Simulation
from phalanx.messages.kinds import Status, Telemetry
from phalanx.native.library import build, missing, require_compiler
from phalanx.native.loop.columns import Batch, ColumnReader
from phalanx.native.loop.eligible import reason_against
from phalanx.native.loop.kernels import Kernels
from phalanx.native.loop.library import compiled_loop
from phalanx.native.loop.records import ColumnRecorder, bits
from phalanx.native.loop.tables import RunMemory
from phalanx.recording.records import RECORDING
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import require_runnable, shared_rows
from phalanx.swarm.swarm import build_swarm

log = logging.getLogger("phalanx.native")
NATIVE, IN_PROCESS = "native", "in-process"
_OPTIONS, _OVER = RunOptions(NATIVE), 1
_WHY = {
    -1: "a number is no longer finite",
    -2: "a link's rule makes too many copies, or none that can arrive",
    -3: "too many broadcasts are under way at once",
}
"""Of a call that failed."""


class LoopError(Exception):
    """The loop cannot go on: the run is to be made in process, which says what is wrong."""


class CompiledRun:
    """A run's tables and functions, ready to begin."""

    def __init__(self, rows: SafetyRows, memory: RunMemory, loop: ctypes.PyDLL) -> None:
        self.rows, self._memory, self._loop = rows, memory, loop
        self._place = ctypes.c_void_p(memory.run.words.ctypes.data)
        self.reader = ColumnReader(rows, memory.run)
        loop.begin(self._place)

    def advance(self) -> int:
        """Go on until the results are full; return 1 if the run is over. Raises LoopError."""
        status = int(self._loop.advance(self._place))
        if status < 0:
            raise LoopError(_WHY[status])
        return status


def compiled_run(rows: SafetyRows) -> CompiledRun | None:
    """Return a run of eligible rows; None if a function of it is not compiled."""
    kernels, loop = Kernels(), compiled_loop()
    memory = RunMemory(rows, kernels)
    return CompiledRun(rows, memory, loop) if loop and kernels.complete else None


class NativeSimulation(Simulation):
    """A run whose steps are made in C; it is judged and recorded as in process."""

    def __init__(
        self, run: CompiledRun, records: Path | RecordSink | None, options: RunOptions = _OPTIONS,
        keeper: TrackKeeper | None = None,
    ) -> None:  # fmt: skip
        """records and options: as Simulation takes them. keeper: keeps columns of events."""
        self._run, self._keeper = run, keeper
        super().__init__(run.rows, records, options)

    def _plant_run(self, sink: RecordSink | None, opened: ExitStack) -> PlantRun:
        clock = _Clock(self._run, sink, self._keeper)
        clock.plant = PlantRun(self._rows, self, None, self.queue, lambda *_: clock)
        return clock.plant

    def _compile(self) -> None:
        """Do nothing: all is compiled."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Raise an error: reports are among the columns."""
        raise NotImplementedError

    def publish_status(self, message: Status) -> None:
        """Call the run's progress callback."""
        self._options.progress(message)


class _Clock:
    """Lets the loop go on, and has its events judged, hashed and recorded."""

    punctuality = None
    plant: PlantRun

    def __init__(
        self, run: CompiledRun, sink: RecordSink | None, keeper: TrackKeeper | None
    ) -> None:
        swarm, self._keeper = run.rows.swarm, keeper
        self._run, self._sizes = run, np.array([len(m.dynamics.inputs) for m in swarm.members])
        self._recorder = None if sink is None else ColumnRecorder(swarm, sink)

    def run(self, duration: float) -> None:
        """Run to the end. Raises LoopError, RecordingError and KeyboardInterrupt."""
        reader, world, status = self._run.reader, self.plant.world, 0
        while status != _OVER:
            began = time.perf_counter()
            status = self._run.advance()
            batch, seconds = reader.read(), time.perf_counter() - began
            if batch is not None:
                self._judge(batch, seconds / max(len(batch.answers["i"]), 1))
                world.t, world.x = reader.t, reader.x
                self.plant.publisher.reach(reader.t, reader.x)
                self.plant.publisher.idle(time.monotonic())
            interrupt.raise_pending()

    def _judge(self, batch: Batch, seconds: float) -> None:
        """Judge what happened; seconds: wall time of a step."""
        judge, columns = self.plant.judge, batch.columns
        evaluated = list(judge.evaluation.of_segments(batch.segments))
        if judge.diverged(evaluated) is not None:
            raise LoopError(_WHY[-1])
        judge.add_pieces([[DisturbanceKnot(t, phi) for t, phi in batch.knots]])
        folded = judge.fold(columns, evaluated)
        faults = batch.answers.lists["fates"]["fate_faults"]
        hits = Counter(n for word in faults[faults != 0].tolist() for n in bits(word))
        backups = judge.add_reports(columns.inputs, batch.answers["rejected"], hits)
        self.plant.trajectory.add_columns(columns.states, columns.inputs, self._sizes)
        if self._keeper is not None:
            self._keeper.keep(columns)
        if self._recorder is not None:
            states, inputs = columns.states, columns.inputs
            notices = {int(states.number[row]): lines for row, lines in folded.notices.items()}
            notices |= {int(inputs.number[row]): lines for row, lines in backups.items()}
            peaks, certified = folded.extremes.peaks, folded.certified
            self._recorder.record(batch, peaks, certified, notices, seconds)


def run_native(scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions) -> Summary:
    """Run a scenario to its verdict, as an Engine; in process if it cannot be run in C."""
    rows, reason = _runnable(scenario, options)
    if reason:
        log.warning("in process, not native: %s", reason)
    return run_or_else(None if reason else compiled_run(rows), scenario, make_folder, options)


def run_or_else(
    run: CompiledRun | None, scenario: Scenario, make_folder: Callable[[], Path],
    options: RunOptions,
) -> Summary:  # fmt: skip
    """Run to the verdict; in process if there is no compiled run, or it cannot go on."""
    rows = None if run else shared_rows(scenario)
    folder = make_folder()
    # A Ctrl-C must not interrupt writing: it ends the run at the next sample.
    with interrupt.handled(), interrupt.deferred():
        if run is not None:
            try:
                return NativeSimulation(run, folder, options).run()
            except LoopError as error:
                log.warning("in process, not native: %s", error)
                (folder / RECORDING).unlink()
        return Simulation(rows or shared_rows(scenario), folder, options).run()


def _runnable(scenario: Scenario, options: RunOptions) -> tuple[SafetyRows, str]:
    """Return rows whose functions are compiled, and why they cannot be run in C, if so."""
    rows = require_runnable(build_swarm(scenario))
    reason = reason_against(rows)
    if options.commands.schedule:
        reason = reason or "it has commands"
    if reason:
        return rows, reason
    try:
        return compiled_rows(scenario), ""
    except OSError as error:
        return rows, str(error)


def compiled_rows(scenario: Scenario) -> SafetyRows:
    """Return an eligible scenario's rows, with all functions that the loop calls compiled.

    Raises OSError: there is no compiler, it fails, or the cache cannot be written.
    """
    require_compiler()
    with missing() as functions:
        compiled_run(require_runnable(build_swarm(scenario)))
    build(functions, lambda _: None)
    return require_runnable(build_swarm(scenario))
