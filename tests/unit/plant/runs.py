"""Runs of the plant with agents of a test's own, and their reports on control steps."""

from pathlib import Path
from typing import Any

from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.run import ClockFactory, PlantRun

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.messages.kinds import Telemetry
from phalanx.messages.step_report import StepReport
from phalanx.recording.read import Recording, read
from phalanx.recording.write import RecordingWriter
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.rows.origin import Origin


def plant_run(
    rows: SafetyRows,
    agents: Any,
    folder: Path,
    policy: CommandPolicy = NO_COMMANDS,
    clock: ClockFactory = Lockstep,
    audience: Any = None,
) -> tuple[Summary, Recording]:
    """Run the plant to its verdict, recorded in a new file of the folder."""
    file = folder / f"{len(list(folder.iterdir()))}.mcap"
    with RecordingWriter(file, rows.swarm.scenario, "run") as recording:
        commands = CommandQueue(policy, rows.swarm.names)
        summary = PlantRun(rows, agents, recording, commands, clock, audience).run()
        recording.finish(summary)
    return summary, read(file)


STEP = StepReport(origin=Origin.QP, residual=0.0, u_nom=(0.0, 0.0), solve_time=0.0)


def report(k: int, step: StepReport = STEP, **fields) -> Telemetry:
    """Return a report on a control step, by default one that a QP made."""
    return Telemetry(k=k, report=step, **{"ages": (), **fields})
