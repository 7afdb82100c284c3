"""One run of the plant, of any agents: world, clock, judge and observers put together."""

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from phalanx.guarantee.verdict import FaultCount, Outcome, Punctuality, Summary, judge
from phalanx.profile.stopwatch import Stopwatch
from phalanx.recording.write import RecordingError, RecordingWriter
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.asked import MistakenMethodError
from phalanx.wire.messages import Status, Telemetry
from phalanx_plant.clock.commands import CommandQueue, declared
from phalanx_plant.judge.backlog import Backlog
from phalanx_plant.judge.judge import Judge
from phalanx_plant.observers.publisher import FrameAudience, Publisher
from phalanx_plant.observers.recorder import Recorder, TrajectoryHash
from phalanx_plant.sampling.sampling import Sampling
from phalanx_plant.world.events import AbandonedError, StoppedError, SwarmBrokenError
from phalanx_plant.world.world import DivergedError, World

log = logging.getLogger("phalanx.plant")


class ReportingAgents(Protocol):
    """Reports of agents' control steps, and of the run's progress."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """How agent i made its input for sample k."""

    def publish_status(self, message: Status) -> None:
        """Tell whoever watches how far the run is."""


class Clock(Protocol):
    """Virtual time or real time: when agents sample, and when their inputs take effect."""

    @property
    def punctuality(self) -> Punctuality | None:
        """How the run kept its times; None in virtual time, which is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """


ClockFactory = Callable[[World, Sampling, Any, Backlog, CommandQueue], Clock]
"""Makes the clock of a run, at time 0, of agents as that clock needs them."""


class PlantRun:
    """A run from its first sample to its summary."""

    def __init__(
        self,
        rows: SafetyRows,
        agents: ReportingAgents,
        recording: RecordingWriter,
        commands: CommandQueue,
        clock: ClockFactory,
        audience: FrameAudience | None = None,
    ) -> None:
        """Put a run together.

        Args:
            rows: of the scenario.
            agents: of the run, as its clock needs them.
            recording: of the run.
            commands: to obey.
            clock: makes its clock.
            audience: is shown frames.
        """
        swarm = rows.swarm
        self._scenario, self._declared = swarm.scenario, swarm.links.declared
        self._recording, self._commands = recording, commands
        commands.declare(declared(swarm))
        self._world, self._sampling = World(rows), Sampling(swarm)
        self._judge = Judge(rows, agents.await_telemetry)
        for seen in self._judge.truth.of([self._world.take_way()]):
            self._judge.saw(seen)
        self._trajectory = TrajectoryHash()
        self._publisher = Publisher(
            self._world, self._judge, commands, agents.publish_status, audience
        )
        recorder = Recorder(swarm, recording)
        # What becomes of every event once it was judged, in this order.
        observers = (self._trajectory.add, self._publisher.see, recorder.record)
        happened = Backlog(self._judge, observers, self._publisher.idle)
        self._clock = clock(self._world, self._sampling, agents, happened, commands)

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell the plant's own phases apart."""
        stopwatch.time(self._world.integration.motion, "steps", "integrate")
        stopwatch.time(self._judge.truth, "of", "truth")
        for call in ("prepare", "take"):
            stopwatch.time(self._judge, call, "judge")
        stopwatch.time(self._recording, "write", "record")
        stopwatch.time(self._publisher, "show", "show")
        stopwatch.time(self._commands, "take", "wait")

    def run(
        self,
        prepare: Callable[[], None] = lambda: None,
        rejected: Callable[[], Mapping[str, int]] = dict,
    ) -> Summary:
        """Run to the end of the scenario, or as far as it goes.

        Args:
            prepare: called first; waits for the agents.
            rejected: payloads that were dropped on the way, by reason.
        """
        began = time.monotonic()
        try:
            prepare()
            began = time.monotonic()
            with endless_loops(self._scenario.time.timeout):
                self._clock.run(self._scenario.duration)
            self._publisher.show(last=True)
            extremes = self._judge.extremes
            outcome, reason = judge(
                extremes.violations(),
                self._judge.assumptions.of_guarantee,
                self._judge.assumptions.of_theorem,
                extremes.apart(),
            )
        except (StoppedError, KeyboardInterrupt) as error:
            outcome, reason = Outcome.STOPPED, str(error) or "stopped by the user"
        except MistakenMethodError as error:
            outcome, reason = Outcome.BROKEN, error.told("the plant")
        except (SwarmBrokenError, AbandonedError, RecordingError, DivergedError) as error:
            outcome, reason = Outcome.BROKEN, str(error)
        log.info("%s at t = %.3f s: %s", outcome, self._world.t, reason)
        wall = time.monotonic() - began
        dropped = {
            **rejected(),
            **self._commands.refusals.counts,
            **self._judge.rejected,
        }
        return self._summary(outcome, reason, dropped, wall)

    def _summary(
        self, outcome: Outcome, reason: str, rejected: dict[str, int], wall: float
    ) -> Summary:
        checked, extremes = self._judge, self._judge.extremes
        hits = checked.claims.faults + self._sampling.faults
        return Summary(
            outcome=outcome,
            reason=reason,
            t=self._world.t,
            seed=self._scenario.seed,
            trajectory=self._trajectory.hexadecimal,
            worst_h_tot=extremes.worst_h_tot,
            worst_at=extremes.worst_at,
            worst_pair=extremes.worst_pair,
            steps=checked.steps,
            origins=checked.origins,
            assumptions=checked.assumptions.of_guarantee,
            theorem=checked.assumptions.of_theorem,
            certificates=checked.coverage.summary,
            violations=extremes.violations(),
            apart=extremes.apart(),
            rejected=rejected,
            wall_time=wall,
            punctuality=self._clock.punctuality,
            faults=[FaultCount(name, hits[number]) for number, name in enumerate(self._declared)],
        )
