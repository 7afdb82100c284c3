"""Execute a scenario in a folder with the engine asked for."""

import secrets
from pathlib import Path

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import Announce, Engine, Progress, silent
from phalanx.scenario.model import Scenario


def execute(
    scenario: Scenario,
    folder: Path,
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
    """Run a scenario to its summary; arguments as phalanx.run has them.

    Raises:
        EngineError: the run could not begin, or ended without a verdict.
    """
    # An engine brings its own libraries; who uses one need not load the other's.
    if engine == "in-process":
        from phalanx.launcher.in_process_engine import run_in_process

        return run_in_process(scenario, folder, commands, progress, profile)
    from phalanx.launcher.process_engine import run_processes
    from phalanx.wire.endpoints import reserved_endpoint
    from phalanx.wire.membership import Membership

    with reserved_endpoint() as endpoint:
        membership = Membership(
            run=folder.name,
            endpoint=listen or endpoint,
            secret=secret or secrets.token_bytes(16),
        )
        return run_processes(
            scenario, folder, membership, commands, progress, announce, profile, real_time
        )
