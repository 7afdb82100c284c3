"""phalanx compile: the functions that a scenario's runs call, as machine code."""

import contextlib
import time
from collections.abc import Callable

from phalanx_plant.run import ENDINGS

from phalanx.launcher.simulation import Simulation
from phalanx.scenario.model import Scenario
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.native import build, missing, require_compiler

_PATIENCE = 20.0
"""Wall time of the run that shows which functions are needed, at most [s]."""


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
        rows = require_runnable(build_swarm(scenario))
        compile_rows(rows)
        run, end = Simulation(rows), time.monotonic() + _PATIENCE
        while time.monotonic() < end and run.advance(steps=1):
            pass
        run.finish("long enough")
    build(functions, lambda count: progress(count, len(functions)))
    return len(functions)
