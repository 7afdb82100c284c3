"""A run in this process without a recording: to branch, to learn, and to see what it computes.

A branch is a forked process that goes on with another seed. Its bits are those of a run of the
scenario whose `reseed` says so.
"""

import contextlib
import time
from collections.abc import Callable, Sequence

from phalanx_plant.run import ENDINGS, ended_by

from phalanx.arrays import Array
from phalanx.faults.commands import Command, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.in_process_engine import DirectRun
from phalanx.scenario.model import Reseed, Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.native import build, missing, require_compiler

_PATIENCE = 20.0
"""Wall time of the run that shows which functions are needed, at most [s]."""
_PARTS = 50
"""Parts of that run, between which the time is read."""


class Trunk:
    """A run between two instants, from which branches start; it is not recorded."""

    def __init__(self, rows: SafetyRows, commands: Sequence[Command] = ()) -> None:
        """Begin at t = 0, with scheduled commands."""
        swarm = self._swarm = rows.swarm
        self._scenario, self._commands, self._began = swarm.scenario, commands, time.monotonic()
        run = DirectRun(rows, None, CommandPolicy(schedule=tuple(commands)))
        self._plant, self._clock = run.plant, run.clock
        self._instants = self._clock.instants(self._scenario.duration)

    @property
    def t(self) -> float:
        """Virtual time reached [s]."""
        return self._clock.world.t

    @property
    def x(self) -> Array:
        """True stacked state, shape (n̄,)."""
        return self._clock.world.x

    @property
    def worst_h(self) -> float:
        """Largest h of a pair so far, at an instant or between two."""
        return self._plant.judge.extremes.largest_h

    def advance(self, t: float) -> None:
        """Go on through all instants before t [s], and judge them. Raises one of ENDINGS if the run
        breaks.
        """
        with endless_loops(self._scenario.time.timeout):
            while self._clock.next_instant < min(t, self._scenario.duration):
                next(self._instants)
            self._clock.catch_up()

    def reseeded(self, t: float, seed: int) -> Summary:
        """Go to the end with another seed from t [s] on; t is after the last instant.

        It is for a forked process: this run is used up.
        """
        if any(fault.drawn_ahead for fault in self._scenario.faults):
            # What is drawn before a run is drawn again by a run from its start alone.
            later = (*self._scenario.reseed, Reseed(at=t, seed=seed))
            again = self._scenario.model_copy(update={"reseed": later})
            return trunk_of(again, self._commands).finish()
        self._swarm.seeds.change(t, seed)
        return self.finish()

    def close(self) -> None:
        """End the run where it is."""
        self._instants.close()

    def stop(self) -> Summary:
        """End the run where it is, and judge it."""
        self.close()
        return self._plant.summary(self._plant.complete(), self._wall, rejected={})

    def finish(self) -> Summary:
        """Go to the end, and judge the run."""
        try:
            with endless_loops(self._scenario.time.timeout):
                for _ in self._instants:
                    pass
            end = self._plant.complete()
        except ENDINGS as error:
            end = ended_by(error)
        return self._plant.summary(end, self._wall, rejected={})

    @property
    def _wall(self) -> float:
        return time.monotonic() - self._began


def trunk_of(scenario: Scenario, commands: Sequence[Command] = ()) -> Trunk:
    """Begin a scenario, with all compiled that branches share. Raises ScenarioError."""
    rows = require_runnable(build_swarm(scenario))
    compile_rows(rows)
    return Trunk(rows, commands)


def compile_scenario(scenario: Scenario, progress: Callable[[int, int], None]) -> int:
    """Compile the functions that the scenario's runs call, unless the cache has them.

    A run in this process, or the beginning of a long one, shows which these are. Progress is called
    with the number compiled, and of all that will be.

    Returns the number compiled. Raises ScenarioError, and OSError if there is no compiler, it
    fails, or the cache cannot be written.
    """
    require_compiler()
    # If the run breaks, what it called until then is known.
    with missing() as functions, contextlib.suppress(*ENDINGS):
        trunk, end = trunk_of(scenario), time.monotonic() + _PATIENCE
        for part in range(1, _PARTS + 1):
            trunk.advance(scenario.duration * part / _PARTS)
            if time.monotonic() > end:
                break
        trunk.stop()
    build(functions, lambda count: progress(count, len(functions)))
    return len(functions)
