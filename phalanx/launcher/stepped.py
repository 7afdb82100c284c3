"""phalanx.start: a run in this process that goes on one instant at a time, as its caller asks.

It is the in-process engine's run: the same control steps, plant and recording, and the same bits.
"""

import math
import weakref
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from phalanx.faults.commands import (
    NO_COMMANDS,
    Command,
    CommandKind,
    CommandPolicy,
    require_valid,
)
from phalanx.launcher.engine import RunOptions
from phalanx.launcher.run import Run, folder_for_runs, new_folder
from phalanx.launcher.simulation import Simulation
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.user_methods import error_line

S = TypeVar("S", bound="SteppedRun")


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
    return start_as(SteppedRun, scenario, out=out, commands=commands)


def start_as(
    kind: type[S],
    scenario: Scenario | str | Path,
    *,
    out: str | Path | None = None,
    commands: CommandPolicy = NO_COMMANDS,
) -> S:
    """Begin a run of a class of one's own, as start does."""
    options = RunOptions("in-process", commands=commands)
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    rows = require_runnable(build_swarm(scenario))
    require_valid(commands.schedule, rows.swarm.names)
    compile_rows(rows)
    return kind(rows, out, options)


class SteppedRun(AbstractContextManager["SteppedRun"]):
    """A run between two instants: samples were answered, and inputs applied, up to `t`.

    Its bits are those of run with the same commands. It is ended by `end`, by its `with` block, or
    with the program; its recording is whole then.
    """

    def __init__(self, rows: SafetyRows, out: str | Path | None, options: RunOptions) -> None:
        """Begin at t = 0; start describes out."""
        self._swarm, self._schedule = rows.swarm, options.commands.schedule
        self._temporary, parent = folder_for_runs(out)
        self.folder = new_folder(parent, rows.swarm.scenario.name)
        """The run's folder, with its recording."""
        self._simulation = Simulation(rows, self.folder, options)
        self._commands: list[Command] = []
        # Also at the program's end; it holds no reference to this object.
        self._forgotten = weakref.finalize(self, self._simulation.finish, "its program left it")

    @property
    def scenario(self) -> Scenario:
        """The resolved scenario."""
        return self._swarm.scenario

    @property
    def t(self) -> float:
        """Virtual time reached [s]."""
        return self._simulation.clock.world.t

    @property
    def over(self) -> bool:
        """True if the run went to its end, broke, or was ended."""
        return self._simulation.summary is not None

    @property
    def states(self) -> dict[str, Array]:
        """True state of every agent, by name."""
        x, parts = self._simulation.clock.world.x, self._swarm.safe_set.parts
        return {n: x[part].copy() for n, part in zip(self._swarm.names, parts, strict=True)}

    @property
    def inputs(self) -> dict[str, Array]:
        """Input that every agent's actuator holds, by name; zero before its first."""
        held_input = self._simulation.clock.world.integration.held
        return {name: held_input(i) for i, name in enumerate(self._swarm.names)}

    @property
    def h(self) -> dict[str, float]:
        """Every pair's h, as "<agent>-<agent>"; safe is h <= 0."""
        h_of_pairs = self._swarm.h_of_pairs(self._simulation.clock.world.x[None])
        return {label: float(h[0]) for label, h in h_of_pairs.items()}

    @property
    def commands(self) -> tuple[Command, ...]:
        """All commands given so far, each with its time: run repeats them as a schedule."""
        return (*self._schedule, *self._commands)

    def step(self) -> bool:
        """Go on to the next instant, at which agents sample or inputs take effect.

        Returns False when the run is over.

        Raises KeyboardInterrupt: Ctrl-C during the step; the run has ended, as stopped.
        """
        return self._simulation.advance(steps=1)

    def until(self, t: float = math.inf) -> bool:
        """Go on through all instants up to and including t [s], by default to the end.

        Returns and raises as step does.
        """
        return self._simulation.advance(t)

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
        simulation = self._simulation
        if self.over:
            raise ValueError(f"the run is over, at t = {self.t:g} s")
        next_instant = simulation.clock.next_instant
        command = Command(next_instant if at is None else at, kind, agent, value)
        if not command.changes_trajectory and kind in set(CommandKind):
            raise ValueError(f"kind: {kind!r} changes the pace only, which is the caller's here")
        if not next_instant <= command.t < self.scenario.duration:
            raise ValueError(
                f"at: expected a time from the next instant, {next_instant:g} s, to before the "
                f"end, {self.scenario.duration:g} s, got {command.t:g}"
            )
        simulation.queue.add(command)
        self._commands.append(command)
        return command

    def end(self) -> Run:
        """End the run, as stopped unless it went to its end; return the finished run."""
        return self._end("ended by its program")

    def _end(self, reason: str) -> Run:
        self._simulation.finish(reason)
        return Run(self.folder, self._simulation.summary, self._temporary)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._end(f"ended by {error_line(error)}" if error else "ended by its program")

    def __repr__(self) -> str:
        state = self._simulation.summary.outcome if self._simulation.summary else "running"
        name, duration = self.scenario.name, self.scenario.duration
        return f"SteppedRun({name!r}, t = {self.t:.6g} of {duration:g} s, {state})"
