"""One run of the plant: world, clock, judge and observers of one scenario."""

import logging
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from phalanx.guarantee.verdict import FaultCount, Outcome, Punctuality, Summary, judge
from phalanx.messages.kinds import Status, Telemetry
from phalanx.messages.profile import Stopwatch
from phalanx.recording.write import RecordingError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.user_methods import MistakenMethodError, error_line
from phalanx_plant.clock.commands import CommandQueue, declared
from phalanx_plant.judge.event_queue import EventQueue
from phalanx_plant.judge.judge import Judge
from phalanx_plant.observers.publisher import FrameAudience, Publisher
from phalanx_plant.observers.recorder import Recorder, RecordSink, TrajectoryHash
from phalanx_plant.sampling.sampling import Sampling
from phalanx_plant.world.events import AbandonedError, StoppedError, SwarmBrokenError
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
    ) -> None:
        """Assemble a run.

        Args:
            rows: of the scenario.
            agents: of the run, as its clock uses them.
            recording: takes the run's records; None: there are none.
            commands: of the run.
            clock: makes its clock.
            audience: receives frames.
        """
        swarm = rows.swarm
        self._scenario, self._declared = swarm.scenario, swarm.links.declared
        self._recording, self._commands = recording, commands
        commands.declare(declared(swarm))
        self._world, self._sampling = _world(rows), Sampling(swarm)
        self.judge = Judge(rows, agents.await_telemetry)
        self.judge.begin(self._world.take_history())
        self._trajectory = TrajectoryHash()
        self._publisher = Publisher(
            self._world, self.judge, commands, agents.publish_status, audience
        )
        # They receive each judged event in this order.
        observers = [self._trajectory.add, self._publisher.see]
        if recording is not None:
            observers.append(Recorder(swarm, recording).record)
        events = EventQueue(self.judge, observers, self._publisher.idle)
        self._clock = clock(self._world, self._sampling, agents, events, commands)

    def time(self, stopwatch: Stopwatch) -> None:
        """Time the phases of the plant's work."""
        stopwatch.time(self._world.integration.motion, "steps", "integrate")
        stopwatch.time(self.judge.evaluation, "of", "truth")
        stopwatch.time(self.judge, "judge", "judge")
        if self._recording is not None:
            stopwatch.time(self._recording, "write", "record")
        stopwatch.time(self._publisher, "show", "show")
        stopwatch.time(self._commands, "wait_until", "wait")

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
            self._publisher.begin()
            began = time.monotonic()
            with endless_loops(self._scenario.time.timeout):
                self._clock.run(self._scenario.duration)
            end = self.complete()
        except ENDINGS as error:
            end = ended_by(error)
        finally:
            self._world.integration.close()
        return self.summary(end, time.monotonic() - began, rejected())

    def complete(self) -> End:
        """Judge a run that went to the end of its scenario."""
        self._publisher.show(math.inf)
        assumptions, extremes = self.judge.assumptions, self.judge.extremes
        return End(
            *judge(
                extremes.violations(),
                assumptions.of_guarantee,
                assumptions.of_theorem,
                extremes.excluded(),
            )
        )

    def summary(self, end: End, wall: float, rejected: Mapping[str, int]) -> Summary:
        """Return the key figures of a run that ended; wall: its wall time [s]."""
        outcome, reason = end
        log.info("%s at t = %.3f s: %s", outcome, self._world.t, reason)
        dropped = {
            **rejected,
            **self._commands.refusals.counts,
            **self.judge.rejected,
        }
        return self._summary(outcome, reason, dropped, wall)

    def _summary(
        self, outcome: Outcome, reason: str, rejected: dict[str, int], wall: float
    ) -> Summary:
        checked, extremes = self.judge, self.judge.extremes
        hits = checked.claims.faults + self._sampling.faults
        return Summary(
            outcome=outcome,
            reason=reason,
            t=self._world.t,
            seed=self._scenario.seed,
            trajectory=self._trajectory.hexadecimal,
            worst_h=extremes.worst_h,
            worst_at=extremes.worst_at,
            worst_pair=extremes.worst_pair,
            largest_h_tot=extremes.largest_h_tot,
            largest_h_tot_at=extremes.largest_h_tot_at,
            steps=checked.steps,
            origins=checked.origins,
            assumptions=checked.assumptions.of_guarantee,
            theorem=checked.assumptions.of_theorem,
            certificates=checked.coverage.summary,
            violations=extremes.violations(),
            excluded=extremes.excluded() or [],
            trust=checked.trust,
            rejected=rejected,
            wall_time=wall,
            punctuality=self._clock.punctuality,
            faults=[FaultCount(name, hits[number]) for number, name in enumerate(self._declared)],
        )


def _world(rows: SafetyRows) -> World:
    """Make the world that the scenario names, or the plant's own."""
    named = rows.swarm.scenario.fresh_world()
    return World(rows, ForeignIntegration(rows, named) if named else None)
