"""Runs of the plant with agents of a test's own."""

from pathlib import Path
from typing import Any

from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.run import ClockFactory, PlantRun

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.recording.read import Recording, read
from phalanx.recording.write import RecordingWriter
from phalanx.swarm.rows import SafetyRows


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
