"""A run in this process, whole or instant by instant, and the engine that it is.

World, clock, judge, inbox and control steps are those of the processes engine, so a trajectory
is the same to the last bit. Nothing is sealed or sent.
"""

import gc
import math
import time
from collections import defaultdict
from collections.abc import Callable, Generator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from phalanx_agent.step import control_steps
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.judge.event_queue import LARGE_BATCH
from phalanx_plant.observers.recorder import RecordSink
from phalanx_plant.run import ENDINGS, End, PlantRun, ended_by
from phalanx_plant.sampling.sampling import NoProcesses
from phalanx_plant.world.events import SwarmBrokenError

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import Progress, RunOptions
from phalanx.messages.kinds import Sample, Status, StepFailedError, Telemetry
from phalanx.messages.seal import Malformed
from phalanx.native.library import build, missing, require_compiler
from phalanx.recording.read import Recording
from phalanx.recording.records import RECORDING, SUMMARY, State, Step
from phalanx.recording.write import RecordingWriter, write_summary
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.arrays import Array

_OPTIONS = RunOptions("in-process")
T = TypeVar("T")
_PATIENCE = 20.0
"""Wall time of the run that shows which functions are needed, at most [s]."""


def run_in_process(
    scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions
) -> Summary:
    """Run a scenario to its verdict, as an Engine; progress is called in this thread."""
    rows = require_runnable(build_swarm(scenario))
    interrupt.raise_pending()
    folder = make_folder()
    # A Ctrl-C must not interrupt writing: it ends the run at the next sample.
    with interrupt.handled(), interrupt.deferred():
        return Simulation(rows, folder, options).run()


class Simulation:
    """Plant, agents and clock of one run, from t = 0 to its summary."""

    def __init__(
        self,
        rows: SafetyRows,
        records: Path | RecordSink | None = None,
        options: RunOptions = _OPTIONS,
    ) -> None:
        """Put them together.

        Args:
            rows: of the scenario.
            records: the run's folder, which gets its files; or what takes its records, if anything.
            options: commands and progress of the run.
        """
        self.summary: Summary | None = None
        """Of the run, once it is over."""
        self._rows, self._options = rows, options
        folder, sink = (records, None) if isinstance(records, Path) else (None, records)
        self._folder, self._count = folder, 0
        self._wall = 0.0
        """Time spent in advance, less the time at which its present call began [s]."""
        with ExitStack() as opened:
            if folder:
                writer = RecordingWriter(folder / RECORDING, rows.swarm.scenario, folder.name)
                sink = self._recording = opened.enter_context(writer)
            self.queue = CommandQueue(options.commands, rows.swarm.names)
            self.plant = self._plant_run(sink, opened)
            self._instants = self._watched_instants()
            self._opened = opened.pop_all()

    def _plant_run(self, sink: RecordSink | None, opened: ExitStack) -> PlantRun:
        """Return the plant's part, with agents that go on by themselves; opened: until the end."""
        agents = self.agents = DirectAgents(self._rows, self._options.progress)
        opened.callback(agents.end_programs)
        parts = self._rows, agents, sink, self.queue, self._make_clock
        return PlantRun(*parts, batch=LARGE_BATCH)

    def _make_clock(self, *parts: Any) -> Lockstep:
        self.clock = Lockstep(*parts)
        return self.clock

    def run(self) -> Summary:
        """Run from t = 0 to the end of the scenario, or until an error of ENDINGS."""
        with self._opened:
            summary = self.plant.run(prepare=self._compile)
            if self._folder:
                interrupt.clear()  # also one that came after the last sample
            return self._write(summary)

    def _compile(self) -> None:
        with interrupt.interruptible():
            compile_rows(self._rows)

    # A Ctrl-C must not interrupt judging or writing: it ends the run after the instant.
    @interrupt.handled()
    @interrupt.deferred()
    def advance(self, t: float = math.inf, *, steps: float = math.inf) -> bool:
        """Go on through instants up to t [s], so many at most; return False if the run is over.

        Raises KeyboardInterrupt: Ctrl-C; the run is over, as stopped.
        """
        last = self._count + steps
        self._wall -= time.monotonic()
        try:
            while self.summary is None and self._count < last and self._next <= t:
                self._step()
                if self.summary is None:
                    interrupt.raise_pending()
        except BaseException as error:
            self._finish(ended_by(error))
            if isinstance(error, KeyboardInterrupt) or not isinstance(error, ENDINGS):
                raise
        self._wall += time.monotonic()
        return self.summary is None

    @property
    def _next(self) -> float:
        return min(self.clock.next_instant, self._rows.swarm.scenario.duration)

    def _step(self) -> None:
        if next(self._instants, None) is None:
            self._finish(self.plant.complete())
        else:
            self._count += 1

    def _watched_instants(self) -> Generator[float, None, None]:
        # One thread for all steps: to start one takes as long as a step.
        scenario = self._rows.swarm.scenario
        with endless_loops(scenario.time.timeout):
            yield from self.clock.instants(scenario.duration)

    @interrupt.handled()
    @interrupt.deferred()
    def finish(self, reason: str) -> None:
        """End the run before its end, if it goes on: judge and record what happened."""
        if self.summary is None:
            self._wall -= time.monotonic()
            self._finish(End(Outcome.STOPPED, reason))

    def _finish(self, end: End) -> None:
        with self._opened:
            self._instants.close()  # judges and records what is left
            self.clock.world.integration.close()
            wall = self._wall + time.monotonic()
            self._write(self.plant.summary(end, wall, rejected={}))

    def _write(self, summary: Summary) -> Summary:
        self.summary = summary
        if self._folder:
            write_summary(summary, self._folder / SUMMARY, self._recording)
        return summary


class RecordsInMemory:
    """The records of a run, by their class."""

    def __init__(self) -> None:
        self._of = defaultdict[type, list[Any]](list)

    def write(self, *records: Any) -> None:
        """Append records."""
        for record in records:
            self._of[type(record)].append(record)

    def of(self, kind: type[T]) -> list[T]:
        """Return the records of a class."""
        return self._of[kind]

    def recording(self, scenario: Scenario, summary: Summary | None = None) -> Recording:
        """Return the states and steps so far, as of a run of this scenario with this summary."""
        return Recording(Path(), scenario, {}, self.of(State), self.of(Step), summary=summary)


class DirectAgents(NoProcesses):
    """The agents of one run, in the plant's own process and thread."""

    def __init__(self, rows: SafetyRows, progress: Progress) -> None:
        self._names = rows.swarm.names
        self._rows = rows
        steps = [s for name in rows.swarm.programs for s in control_steps(rows, name)]
        self.steps = {step.i: step for step in steps}
        """The control steps by index of their agents."""
        self._inputs: dict[int, Array] = {}
        self._telemetry: dict[tuple[int, int], Telemetry] = {}
        self._progress = progress

    def send_sample(self, i: int, sample: Sample) -> None:
        """Have agent i answer its sample. Raises SwarmBrokenError if its control step fails."""
        step = self.steps[i]
        try:
            with interrupt.interruptible():  # a law may never return
                answer = step(step.accept_sample(sample))
        except (StepFailedError, Malformed) as error:
            raise SwarmBrokenError(str(error)) from error
        self._inputs[i] = np.array(answer.actuation.u)
        self._telemetry[i, sample.k] = answer.telemetry
        for hearer, broadcast in answer.broadcasts.items():
            self.steps[hearer].inbox.put(i, broadcast)

    def decided(self, i: int) -> Array:
        """Return agent i's input for its last sample, shape (m_i,), which is still to be taken."""
        return self._inputs[i]

    def await_input(self, i: int) -> Array:
        """Return the same, and take it."""
        return self._inputs.pop(i)

    def take_input(self, i: int) -> Array | None:
        """Take the same; None if it was taken."""
        return self._inputs.pop(i, None)

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Return agent i's report on sample k."""
        return self._telemetry.pop((i, k))

    def restart(self, i: int, t: float) -> None:
        """Replace agent i's control step by a new one, unless a controller decides for several."""
        if self._names[i] in self._rows.swarm.programs:
            (self.steps[i],) = control_steps(self._rows, self._names[i])
            if self._rows.swarm.groups[i].program:
                gc.collect()  # with its program

    def end_programs(self) -> None:
        """End the programs of agents, each with the control step that asks it."""
        if any(group.program for group in self._rows.swarm.groups):
            self.steps.clear()
            gc.collect()

    def publish_status(self, message: Status) -> None:
        """Call the run's progress callback."""
        self._progress(message)


def compile_scenario(scenario: Scenario, progress: Callable[[int, int], None]) -> int:
    """Compile the functions that the scenario's runs call, unless the cache has them.

    A run in this process, or the beginning of a long one, shows which these are. Progress is called
    with the number compiled, and of all that will be.

    Returns the number compiled. Raises ScenarioError, and OSError if there is no compiler, it
    fails, or the cache cannot be written.
    """
    require_compiler()
    # If the run breaks, what it called until then is known.
    with missing() as functions, suppress(*ENDINGS):
        rows = require_runnable(build_swarm(scenario))
        compile_rows(rows)
        run, end = Simulation(rows), time.monotonic() + _PATIENCE
        while time.monotonic() < end and run.advance(steps=1):
            pass
        run.finish("long enough")
    build(functions, lambda count: progress(count, len(functions)))
    return len(functions)
