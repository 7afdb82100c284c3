"""The clock of a run: decides when agents sample, and when their inputs take effect."""

from typing import Protocol, TypeVar

from phalanx.faults.commands import FaultState
from phalanx.faults.onboard import Sensors
from phalanx.guarantee.verdict import Punctuality
from phalanx.swarm.rows import SafetyRows
from phalanx_plant.clock.backlog import Witness
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.sampling.schedule import Schedule
from phalanx_plant.world.world import World

A_contra = TypeVar("A_contra", contravariant=True)


class Clock(Protocol):
    """One run from its first sample to its end."""

    sensors: Sensors

    @property
    def punctuality(self) -> Punctuality | None:
        """How the run kept its times; None in virtual time, which is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """


class ClockFactory(Protocol[A_contra]):
    """Makes the clock of a run, of agents as that clock needs them."""

    def __call__(
        self,
        rows: SafetyRows,
        world: World,
        schedule: Schedule,
        agents: A_contra,
        scribe: Witness,
        faults: FaultState,
        commands: CommandQueue,
    ) -> Clock:
        """Make it, at time 0."""
