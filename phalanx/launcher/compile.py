"""Compilation of all that a scenario computes to machine code, for runs to come."""

import contextlib
import time
from collections.abc import Callable

from phalanx_plant.run import ENDINGS

from phalanx.launcher.trunk import Trunk, trunk_of
from phalanx.scenario.model import Scenario
from phalanx.theory.expressions.native import build, missing, require_compiler

_PATIENCE = 20.0
"""Wall time of the run that shows which functions are needed, at most [s]."""
_PARTS = 50
"""Parts of that run, between which the time is read."""


def compile_scenario(scenario: Scenario, progress: Callable[[int, int], None]) -> int:
    """Compile the functions that the scenario's runs call, unless the cache has them.

    A run in this process, or the beginning of a long one, shows which these are.

    Args:
        scenario: to compile.
        progress: called with the number of functions compiled, and of all that will be.

    Returns the number of functions that were compiled.

    Raises:
        ScenarioError: the scenario cannot be run.
        OSError: there is no compiler, it fails, or the cache cannot be written.
    """
    require_compiler()
    # If the run breaks, what it called until then is known.
    with missing() as functions, contextlib.suppress(*ENDINGS):
        _rehearse(trunk_of(scenario), scenario.duration)
    build(functions, lambda count: progress(count, len(functions)))
    return len(functions)


def _rehearse(trunk: Trunk, duration: float) -> None:
    end = time.monotonic() + _PATIENCE
    for part in range(1, _PARTS + 1):
        trunk.advance(duration * part / _PARTS)
        if time.monotonic() > end:
            break
    trunk.stop()
