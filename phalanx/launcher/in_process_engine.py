"""The in-process engine: the same control steps called directly, for studies of many runs.

World, clock, judge, inbox and control steps are those of the processes engine, so a trajectory
is the same to the last bit. Nothing is sealed or sent.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from phalanx_agent.step import control_steps
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.observers.recorder import RecordSink
from phalanx_plant.run import PlantRun
from phalanx_plant.world.events import SwarmBrokenError

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import Progress, RunOptions, silent
from phalanx.messages.kinds import Sample, Status, StepFailedError, Telemetry
from phalanx.messages.profile import Stopwatch
from phalanx.messages.seal import Malformed
from phalanx.recording.records import PROFILE, RECORDING, SUMMARY
from phalanx.recording.write import RecordingWriter, write_summary
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array

T = TypeVar("T")


def run_in_process(
    scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions
) -> Summary:
    """Run a scenario to its verdict, as an Engine; progress is called in this thread."""
    rows = require_runnable(build_swarm(scenario))
    interrupt.raise_pending()
    return _run(rows, make_folder(), options)


# A Ctrl-C must not interrupt writing: it ends the run at the next sample.
@interrupt.handled()
@interrupt.deferred()
def _run(rows: SafetyRows, folder: Path, options: RunOptions) -> Summary:
    with RecordingWriter(folder / RECORDING, rows.swarm.scenario, folder.name) as recording:
        stopwatch = Stopwatch()
        summary = simulate(rows, recording, options, stopwatch)
        interrupt.clear()
        if options.profile:
            stopwatch.write(folder / PROFILE, "in-process")
        write_summary(summary, folder / SUMMARY, recording)
    return summary


def simulate(
    rows: SafetyRows,
    records: RecordSink,
    options: RunOptions | None = None,
    stopwatch: Stopwatch | None = None,
) -> Summary:
    """Run to the verdict without files; all records go to `records`.

    stopwatch: times the phases if the options ask for it.
    """
    options = options or RunOptions("in-process")
    run = DirectRun(rows, records, options.commands, options.progress)
    if options.profile and stopwatch is not None:
        run.plant.time(stopwatch)
        stopwatch.time(run.agents, "send_sample", "compute")
    return run.plant.run(prepare=interrupt.NotDeferred()(lambda: compile_rows(rows)))


class RecordsInMemory:
    """The records of a run, by their class."""

    def __init__(self) -> None:
        self._of: dict[type, list[Any]] = {}

    def write(self, *records: Any) -> None:
        """Append records."""
        for record in records:
            self._of.setdefault(type(record), []).append(record)

    def of(self, kind: type[T]) -> list[T]:
        """Return the records of a class, in their order."""
        return self._of.get(kind, [])


class DirectRun:
    """Plant, agents and clock of one run in this process, at t = 0."""

    def __init__(
        self,
        rows: SafetyRows,
        records: RecordSink | None,
        commands: CommandPolicy = NO_COMMANDS,
        progress: Progress = silent,
    ) -> None:
        """Put them together; records: as PlantRun takes them."""
        self.agents = DirectAgents(rows, progress)
        self.queue = CommandQueue(commands, rows.swarm.names)
        self.plant = PlantRun(rows, self.agents, records, self.queue, self._make_clock)

    def _make_clock(self, *parts: Any) -> Lockstep:
        self.clock = Lockstep(*parts)
        return self.clock


class DirectAgents:
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
            with interrupt.NotDeferred():  # a law may never return
                answer = step(step.accept_sample(sample))
        except (StepFailedError, Malformed) as error:
            raise SwarmBrokenError(str(error)) from error
        self._inputs[i] = np.array(answer.actuation.u)
        self._telemetry[i, sample.k] = answer.telemetry
        for hearer, broadcast in answer.broadcasts.items():
            self.steps[hearer].inbox.put(i, broadcast)

    def await_input(self, i: int) -> Array:
        """Return agent i's input for its last sample, shape (m_i,)."""
        return self._inputs.pop(i)

    def take_input(self, i: int) -> Array | None:
        """Return the same, or None if it was taken."""
        return self._inputs.pop(i, None)

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Return agent i's report on sample k."""
        return self._telemetry.pop((i, k))

    def pause(self, i: int, t: float) -> None:
        """Do nothing: there is no process to stop, and the plant sends no samples meanwhile."""

    def resume(self, i: int, t: float) -> None:
        """Do nothing, as pause."""

    def kill(self, i: int, order: Sample) -> None:
        """Do nothing, as pause."""

    def restart(self, i: int, t: float) -> None:
        """Replace agent i's control step by a new one, unless a controller decides for several."""
        if self._names[i] in self._rows.swarm.programs:
            (self.steps[i],) = control_steps(self._rows, self._names[i])

    def publish_status(self, message: Status) -> None:
        """Call the run's progress callback."""
        self._progress(message)
