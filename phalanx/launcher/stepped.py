"""phalanx.start: a run in this process that goes on one instant at a time, as its caller asks.

It is the in-process engine's run: the same control steps, plant and recording, and the same bits.
"""

import math
import tempfile
import time
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType

from phalanx_plant.run import ENDINGS, End, ended_by

from phalanx.faults.commands import (
    NO_COMMANDS,
    Command,
    CommandKind,
    CommandPolicy,
    require_valid,
)
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import RunOptions
from phalanx.launcher.in_process_engine import DirectRun
from phalanx.launcher.run import Run
from phalanx.launcher.start import new_folder
from phalanx.recording.records import RECORDING, SUMMARY
from phalanx.recording.tables import h_of_pairs
from phalanx.recording.write import RecordingWriter, write_summary
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.user_methods import error_line


def start(
    scenario: Scenario | str | Path,
    *,
    out: str | Path | None = None,
    commands: CommandPolicy = NO_COMMANDS,
) -> "SteppedRun":
    """Begin a run that goes on only as far as it is asked to, in this process.

    Args:
        scenario: as load returns it, or a file or name that load takes.
        out: as run takes it.
        commands: scheduled ones, as run takes them.

    Returns:
        The run at t = 0, before its first instant.

    Raises:
        ScenarioError: the scenario cannot be run.
        ValueError: a command is invalid, or they have a secret, which needs a hub.
        OSError: no folder can be made.
    """
    RunOptions("in-process", commands=commands)
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    rows = require_runnable(build_swarm(scenario))
    require_valid(commands.schedule, rows.swarm.names)
    compile_rows(rows)
    return SteppedRun(rows, out, commands)


class SteppedRun(AbstractContextManager["SteppedRun"]):
    """A run between two instants: samples were answered, and inputs applied, up to `t`.

    Its bits are those of run with the same commands. It is ended by `end`, by its `with` block, or
    with the program; its recording is whole then.
    """

    def __init__(self, rows: SafetyRows, out: str | Path | None, policy: CommandPolicy) -> None:
        """Begin at t = 0; start describes out and policy."""
        self._swarm, self._policy = rows.swarm, policy
        self._temporary = tempfile.TemporaryDirectory(prefix="phalanx-") if out is None else None
        parent = Path(self._temporary.name if self._temporary else out or "")
        self._course = _Course(rows, new_folder(parent, rows.swarm.scenario.name), policy)
        self._given: list[Command] = []
        # Also at the program's end; it holds no reference to this object.
        self._forgotten = weakref.finalize(self, self._course.stop, "its program left it")

    @property
    def scenario(self) -> Scenario:
        """The resolved scenario."""
        return self._swarm.scenario

    @property
    def folder(self) -> Path:
        """The run's folder, with its recording."""
        return self._course.folder

    @property
    def t(self) -> float:
        """Virtual time reached [s]."""
        return self._course.world.t

    @property
    def over(self) -> bool:
        """True if the run went to its end, broke, or was ended."""
        return self._course.summary is not None

    @property
    def states(self) -> dict[str, Array]:
        """True state of every agent, by name."""
        x, parts = self._course.world.x, self._swarm.safe_set.parts
        return {n: x[own].copy() for n, own in zip(self._swarm.names, parts, strict=True)}

    @property
    def inputs(self) -> dict[str, Array]:
        """Input that every agent's actuator holds, by name; zero before its first."""
        held = self._course.world.integration.held
        return {name: held(i) for i, name in enumerate(self._swarm.names)}

    @property
    def h(self) -> dict[str, float]:
        """Every pair's h, as "<agent>-<agent>"; safe is h <= 0."""
        found = h_of_pairs(self._swarm, self._course.world.x[None])
        return {label: float(h[0]) for label, h in found.items()}

    @property
    def commands(self) -> tuple[Command, ...]:
        """All commands given so far, each with its time: run repeats them as a schedule."""
        return (*self._policy.schedule, *self._given)

    def step(self) -> bool:
        """Go on to the next instant, at which agents sample or inputs take effect.

        Returns False when the run is over.

        Raises KeyboardInterrupt: Ctrl-C during the step; the run has ended, as stopped.
        """
        return self._course.advance(steps=1)

    def until(self, t: float = math.inf) -> bool:
        """Go on through all instants up to and including t [s], by default to the end.

        Returns and raises as step does.
        """
        return self._course.advance(t)

    def __iter__(self) -> Iterator[float]:
        """Step to the end, and yield the time of each instant [s]."""
        while self.step():
            yield self.t

    def command(
        self, kind: str, agent: str = "", value: float = 0.0, *, at: float | None = None
    ) -> Command:
        """Give a command on agents or links, in force from the next instant on.

        Args:
            kind: a CommandKind that changes the trajectory, such as "kill" or "loss".
            agent: its agent, if it concerns one.
            value: of "loss", a probability; of "delay" [s].
            at: a later time at which it takes effect [s].

        Raises ValueError: there is no such command or agent, or its time has passed.
        """
        course = self._course
        if self.over:
            raise ValueError(f"the run is over, at t = {self.t:g} s")
        next_instant = course.clock.next_instant
        command = Command(next_instant if at is None else at, kind, agent, value)
        if not command.changes_trajectory and kind in set(CommandKind):
            raise ValueError(f"kind: {kind!r} changes the pace only, which is the caller's here")
        if not next_instant <= command.t < self.scenario.duration:
            raise ValueError(
                f"at: expected a time from the next instant, {next_instant:g} s, to before the "
                f"end, {self.scenario.duration:g} s, got {command.t:g}"
            )
        course.queue.add(command)
        self._given.append(command)
        return command

    def end(self) -> Run:
        """End the run, as stopped unless it went to its end; return the finished run."""
        return self._end("ended by its program")

    def _end(self, reason: str) -> Run:
        self._course.stop(reason)
        return Run(self.folder, self._course.summary, self._temporary)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._end(f"ended by {error_line(error)}" if error else "ended by its program")

    def __repr__(self) -> str:
        state = self._course.summary.outcome if self._course.summary else "running"
        name, duration = self.scenario.name, self.scenario.duration
        return f"SteppedRun({name!r}, t = {self.t:.6g} of {duration:g} s, {state})"


class _Course:
    """A run from its first instant to its summary."""

    def __init__(self, rows: SafetyRows, folder: Path, policy: CommandPolicy) -> None:
        self.folder, self.steps = folder, 0
        self.summary: Summary | None = None
        scenario = rows.swarm.scenario
        self._stopwatch = 0.0
        """Time spent in steps, less the time at which the current ones began [s]."""
        with ExitStack() as opened:
            self._recording = opened.enter_context(
                RecordingWriter(folder / RECORDING, scenario, folder.name)
            )
            run = DirectRun(rows, self._recording, policy)
            self.queue, self._plant, self.clock = run.queue, run.plant, run.clock
            self.world, self._duration = self.clock.world, scenario.duration
            self._instants = self.clock.instants(scenario.duration)
            # One thread for all steps: to start one takes as long as a step.
            opened.enter_context(endless_loops(scenario.time.timeout))
            self._opened = opened.pop_all()

    # A Ctrl-C must not interrupt judging or writing: it ends the run after the instant.
    @interrupt.handled()
    @interrupt.deferred()
    def advance(self, t: float = math.inf, *, steps: float = math.inf) -> bool:
        """Go on through instants up to t [s], so many at most; return False if the run is over."""
        last = self.steps + steps
        self._stopwatch -= time.monotonic()
        try:
            while self.summary is None and self.steps < last and self._next <= t:
                self._step()
                if self.summary is None:
                    interrupt.raise_pending()
        except BaseException as error:
            self._finish(ended_by(error))
            if isinstance(error, KeyboardInterrupt) or not isinstance(error, ENDINGS):
                raise
        self._stopwatch += time.monotonic()
        return self.summary is None

    @property
    def _next(self) -> float:
        return min(self.clock.next_instant, self._duration)

    def _step(self) -> None:
        if next(self._instants, None) is None:
            self._finish(self._plant.complete())
        else:
            self.steps += 1

    @interrupt.handled()
    @interrupt.deferred()
    def stop(self, reason: str) -> None:
        """End the run before its end, if it goes on: judge and record what happened."""
        if self.summary is None:
            self._stopwatch -= time.monotonic()
            self._finish(End(Outcome.STOPPED, reason))

    def _finish(self, end: End) -> None:
        self._instants.close()  # judges and records what is left
        wall = self._stopwatch + time.monotonic()
        self.summary = self._plant.summary(end, wall, rejected={})
        write_summary(self.summary, self.folder / SUMMARY, self._recording)
        self._opened.close()
