"""One run of the plant: world, clock, judge and observers of one scenario."""

import logging
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from msgspec.structs import asdict

from phalanx.guarantee.verdict import FaultCount, Outcome, Punctuality, Summary, judge
from phalanx.messages.kinds import Status, Telemetry
from phalanx.recording.write import RecordingError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.user_methods import MistakenMethodError, error_line
from phalanx_plant.clock.commands import CommandQueue, declared
from phalanx_plant.judge.event_queue import BATCH, EventQueue
from phalanx_plant.judge.judge import Judge
from phalanx_plant.observers.publisher import FrameAudience, Publisher
from phalanx_plant.observers.recorder import Recorder, RecordSink, TrajectoryHash
from phalanx_plant.sampling.sampling import Sampling
from phalanx_plant.world.events import (
    AbandonedError,
    StateReached,
    StoppedError,
    SwarmBrokenError,
)
from phalanx_plant.world.foreign import ForeignIntegration
from phalanx_plant.world.world import DivergedError, World

log = logging.getLogger("phalanx.plant")


class ReportingAgents(Protocol):
    """The agents as the judge and the publisher use them."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Wait for agent i's report on its sample k."""

    def publish_status(self, message: Status) -> None:
        """Publish the run's progress."""


class Clock(Protocol):
    """Virtual time or real time: it decides the times of samples and inputs."""

    @property
    def punctuality(self) -> Punctuality | None:
        """Delays against planned times; None in virtual time, which is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """


ClockFactory = Callable[[World, Sampling, Any, EventQueue, CommandQueue], Clock]
"""Makes the clock of a run at time 0; the third argument is the agents as that clock uses them."""


class End(NamedTuple):
    """The outcome of a run, and why."""

    outcome: Outcome
    reason: str


ENDINGS = (
    StoppedError,
    KeyboardInterrupt,
    MistakenMethodError,
    SwarmBrokenError,
    AbandonedError,
    RecordingError,
    DivergedError,
)
"""The errors that end a run early, with a summary."""


def ended_by(error: BaseException) -> End:
    """Return how an error ends a run, one of ENDINGS or an unexpected one."""
    match error:
        case StoppedError() | KeyboardInterrupt():
            return End(Outcome.STOPPED, str(error) or "stopped by the user")
    return End(Outcome.BROKEN, str(error) if isinstance(error, ENDINGS) else error_line(error))


class PlantRun:
    """A run from its first sample to its summary."""

    def __init__(
        self,
        rows: SafetyRows,
        agents: ReportingAgents,
        recording: RecordSink | None,
        commands: CommandQueue,
        clock: ClockFactory,
        audience: FrameAudience | None = None,
        batch: int = BATCH,
    ) -> None:
        """Assemble a run.

        Args:
            rows: of the scenario.
            agents: of the run, as its clock uses them.
            recording: takes the run's records; None: there are none.
            commands: of the run.
            clock: makes its clock.
            audience: receives frames.
            batch: most instants judged in one call.
        """
        swarm = rows.swarm
        self._scenario, self._declared = swarm.scenario, swarm.links.declared
        self._commands = commands
        commands.declare(declared(swarm))
        foreign = swarm.scenario.fresh_world()
        integration = ForeignIntegration(swarm, foreign) if foreign else None
        self.world, self._sampling = World(rows, integration), Sampling(swarm)
        self.judge = Judge(rows)
        start = self.judge.begin(StateReached(0.0, self.world.x, self.world.take_history()))
        self.trajectory = TrajectoryHash()
        self.publisher = Publisher(
            swarm.names, start, self.judge, commands, agents.publish_status, audience
        )
        # They receive each judged event in this order.
        observers = [self.trajectory.add, self.publisher.see]
        if recording is not None:
            observers.append(Recorder(swarm, recording).record)
        idle = self.publisher.idle
        events = EventQueue(self.judge, agents.await_telemetry, observers, idle, batch)
        self._clock = clock(self.world, self._sampling, agents, events, commands)

    def run(
        self,
        prepare: Callable[[], None] = lambda: None,
        rejected: Callable[[], Mapping[str, int]] = dict,
    ) -> Summary:
        """Run to the end of the scenario, or until an error.

        Args:
            prepare: called first; waits for the agents.
            rejected: returns the number of dropped payloads by reason.
        """
        began = time.monotonic()
        try:
            prepare()
            self.publisher.begin()
            began = time.monotonic()
            with endless_loops(self._scenario.time.timeout):
                self._clock.run(self._scenario.duration)
            end = self.complete()
        except ENDINGS as error:
            end = ended_by(error)
        finally:
            self.world.integration.close()
        return self.summary(end, time.monotonic() - began, rejected())

    def complete(self) -> End:
        """Judge a run that went to the end of its scenario."""
        self.publisher.show(math.inf)
        f = self.judge.findings()
        return End(*judge(f.violations, f.assumptions, f.theorem, f.excluded))

    def summary(self, end: End, wall: float, rejected: Mapping[str, int]) -> Summary:
        """Return the key figures of a run that ended; wall: its wall time [s]."""
        log.info("%s at t = %.3f s: %s", end.outcome, self.world.t, end.reason)
        findings = asdict(self.judge.findings())
        agents, excluded = findings.pop("rejected"), findings.pop("excluded")
        hits = self.judge.claims.faults + self._sampling.faults
        return Summary(
            outcome=end.outcome,
            reason=end.reason,
            t=self.world.t,
            seed=self._scenario.seed,
            trajectory=self.trajectory.hexadecimal,
            excluded=excluded or [],
            rejected={**rejected, **self._commands.refusals.counts, **agents},
            wall_time=wall,
            punctuality=self._clock.punctuality,
            faults=[FaultCount(name, hits[number]) for number, name in enumerate(self._declared)],
            **findings,
        )
