"""Execute a scenario in a folder with the engine asked for."""

import secrets
from collections.abc import Callable
from pathlib import Path

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import Announce, Engine, Progress, require_engine, silent
from phalanx.launcher.streams import open_closed_streams
from phalanx.scenario.model import Scenario
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm


def execute(
    scenario: Scenario,
    folder: Path | Callable[[], Path],
    *,
    engine: Engine = "processes",
    progress: Progress = silent,
    commands: CommandPolicy = NO_COMMANDS,
    listen: str | None = None,
    secret: bytes = b"",
    announce: Announce = silent,
    profile: bool = False,
    real_time: float | None = None,
) -> Summary:
    """Run a scenario to its summary; arguments as phalanx.run has them, but for the folder.

    folder: of the run; or what makes it, once the scenario is known to be one that can run.

    Raises:
        ScenarioError: the scenario cannot be run.
        EngineError: the run could not begin, or ended without a verdict.
        ValueError: there is no such engine.
    """
    require_engine(engine)
    open_closed_streams()
    # An engine brings its own libraries; who uses one need not load the other's.
    if engine == "in-process":
        from phalanx.launcher.in_process_engine import run_in_process

        rows = require_runnable(build_swarm(scenario))
        interrupt.raise_unanswered()
        return run_in_process(rows, _made(folder), commands, progress, profile)
    from phalanx.launcher.process_engine import run_processes
    from phalanx.launcher.processes import Processes
    from phalanx.wire.endpoints import reserved_endpoint
    from phalanx.wire.membership import Membership

    with Processes(scenario) as processes, reserved_endpoint() as endpoint:
        processes.require_runnable()
        there = _made(folder)
        membership = Membership(
            run=there.name,
            endpoint=listen or endpoint,
            secret=secret or secrets.token_bytes(16),
        )
        return run_processes(
            processes,
            scenario,
            there,
            membership,
            commands,
            progress,
            announce,
            profile,
            real_time,
        )


def _made(folder: Path | Callable[[], Path]) -> Path:
    return folder if isinstance(folder, Path) else folder()
