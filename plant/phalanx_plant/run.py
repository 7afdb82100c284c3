"""One run of the plant, whoever its agents are: world, clock, judge and scribe put together."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

from phalanx.faults.clock import AgentClock
from phalanx.faults.commands import FaultState
from phalanx.guarantee.verdict import FaultCount, Outcome, Summary, judge
from phalanx.profile.stopwatch import Stopwatch
from phalanx.recording.write import RecordingError, RecordingWriter
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.asked import MistakenMethodError
from phalanx.wire.messages import Status, Telemetry
from phalanx_plant.clock.clock import ClockFactory
from phalanx_plant.clock.commands import CommandQueue, declared
from phalanx_plant.events.stop import AbandonedError, StoppedError, SwarmBrokenError
from phalanx_plant.judge.judge import Judge
from phalanx_plant.sampling.harness import Harness
from phalanx_plant.sampling.schedule import Schedule
from phalanx_plant.scribe.frames import FrameAudience, FramePublisher
from phalanx_plant.scribe.scribe import RunScribe
from phalanx_plant.world.truth import Truth
from phalanx_plant.world.world import DivergedError, World

log = logging.getLogger("phalanx.plant")


class ReportingAgents(Protocol):
    """Reports of agents' control steps, and of the run's progress."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """How agent i made its input for sample k."""

    def publish_status(self, message: Status) -> None:
        """Tell whoever watches how far the run is."""


A = TypeVar("A", bound=ReportingAgents)


class PlantRun:
    """A run from its first sample to its summary."""

    def __init__(
        self,
        rows: SafetyRows,
        agents: A,
        recording: RecordingWriter,
        commands: CommandQueue,
        clock: ClockFactory[A],
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
        self._scenario, self._recording = swarm.scenario, recording
        self._declared = swarm.links.declared
        self._world = World(rows)
        self._judge = Judge(rows)
        self._truth = Truth(rows)
        for shown in self._truth.of([self._world.take_way()]):
            self._judge.saw(shown)
        self._commands = commands
        commands.declare(declared(swarm))
        faults = FaultState(swarm.names)
        self._frames = FramePublisher(audience, self._judge, commands, swarm.names, self._world.x)
        self._scribe = RunScribe(
            swarm.names,
            self._declared,
            self._truth,
            self._judge,
            recording,
            self._frames,
            agents.await_telemetry,
            agents.publish_status,
            swarm.scenario.time.recording_step,
        )
        latency, occurrences = swarm.scenario.time.latency, swarm.links.occurrences
        self._clocks = [
            # Its input is due before the next sample, whatever the clock says.
            AgentClock(swarm.clock(i), latency, (o for o in occurrences if o.agent == name))
            for i, name in enumerate(swarm.names)
        ]
        self._harness = Harness(swarm)
        schedule = Schedule(self._clocks, latency, self._harness)
        self._clock = clock(rows, self._world, schedule, agents, self._scribe, faults, commands)

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell the plant's own phases apart."""
        stopwatch.time(self._world.integration.motion, "steps", "integrate")
        stopwatch.time(self._truth, "of", "truth")
        for call in ("reached", "sampled", "applied"):
            stopwatch.time(self._judge, call, "judge")
        stopwatch.time(self._judge.coverage, "proven", "judge")
        stopwatch.time(self._recording, "write", "record")
        stopwatch.time(self._frames, "show", "show")
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
            self._frames.show(last=True)
            extremes = self._judge.extremes
            outcome, reason = judge(
                extremes.violations(),
                self._judge.assumptions,
                self._judge.theorem,
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
            **self._scribe.rejected_by_agents,
        }
        return self._summary(outcome, reason, dropped, wall)

    def _summary(
        self, outcome: Outcome, reason: str, rejected: dict[str, int], wall: float
    ) -> Summary:
        extremes = self._judge.extremes
        hits = self._scribe.faults + self._harness.faults + self._judge.claims.faults
        hits += self._clock.sensors.faults
        hits += sum((clock.faults for clock in self._clocks), Counter())
        return Summary(
            outcome=outcome,
            reason=reason,
            t=self._world.t,
            seed=self._scenario.seed,
            trajectory=self._scribe.trajectory.hexadecimal,
            worst_h_tot=extremes.worst_h_tot,
            worst_at=extremes.worst_at,
            worst_pair=extremes.worst_pair,
            steps=self._judge.steps,
            origins=self._judge.origins,
            assumptions=self._judge.assumptions,
            theorem=self._judge.theorem,
            certificates=self._judge.coverage.summary,
            violations=extremes.violations(),
            apart=extremes.apart(),
            rejected=rejected,
            wall_time=wall,
            punctuality=self._clock.punctuality,
            faults=[FaultCount(name, hits[number]) for number, name in enumerate(self._declared)],
        )
