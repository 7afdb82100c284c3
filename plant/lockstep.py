"""Lockstep virtual time: integrate to the next event, sample, await, apply; as fast as it goes.

Events are sampling instants and the instants at which inputs take effect. The wall clock decides
nothing: the plant waits for every input at the virtual time at which it is due.
"""

import contextlib
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from phalanx.faults.commands import NO_COMMANDS, CommandKind, words
from phalanx.faults.state import Faults
from phalanx.plant.commands import CommandQueue
from phalanx.plant.hub import Hub
from phalanx.plant.judge import Judge
from phalanx.plant.view import FrameAudience, View
from phalanx.plant.world import DisturbanceKnot, IntegrationSteps, World
from phalanx.recording.records import Command, Log, State, Step
from phalanx.recording.write import RecordingError, RecordingWriter
from phalanx.swarm.swarm import Swarm
from phalanx.wire.frames import Condition
from phalanx.wire.messages import VERSION, Input, Orders, Sample, Status

Array = NDArray[np.float64]

_STATUS_EVERY = 0.1
"""Wall time between status messages [s]."""


class Moment(NamedTuple):
    """The world at an event."""

    t: float
    """[s]"""
    x: Array
    """Stacked state, shape (n̄,)."""
    seen: list[IntegrationSteps | DisturbanceKnot]
    """What integration showed since the event before."""


class Agents(Protocol):
    """The agents as the clock sees them: samples out, inputs in."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""

    def await_input(self, i: int) -> Input:
        """Agent i's answer."""

    def publish_status(self, message: Status) -> None:
        """Tell whoever watches how far the run is."""


class Lockstep:
    """One run in virtual time."""

    def __init__(
        self,
        swarm: Swarm,
        agents: Agents,
        judge: Judge,
        recording: RecordingWriter,
        commands: CommandQueue | None = None,
        audience: FrameAudience | None = None,
    ) -> None:
        self.world = World(swarm)
        judge.saw(self.world.take_seen())
        self._faults = Faults(swarm.names)
        self._commands = commands or CommandQueue(NO_COMMANDS, swarm.names)
        self._view = View(audience, judge, self.world, self._commands, self._faults)
        self._swarm, self._agents = swarm, agents
        self._judge, self._recording = judge, recording
        self._duration = swarm.scenario.duration
        self._latency = swarm.scenario.time.latency
        everyone = range(len(swarm.members))
        self._clocks = [swarm.clock(i) for i in everyone]
        self._k = [0 for _ in everyone]
        self._next_sample = [0.0 for _ in everyone]
        self._due: dict[int, float] = {}
        """When each awaited input takes effect [s], by agent."""
        self._broadcast: list[list[tuple[float, int]]] = [[(-np.inf, -1)] for _ in everyone]
        """For each agent, (time, sequence number) of its broadcasts that may still be news."""
        self._began = self._status_at = time.monotonic()
        self._rejected = [0 for _ in everyone]
        self._unsafe = False
        self._happened: list[Moment | tuple[int, Input]] = []

    def run(self) -> None:
        """Run to the scenario's duration.

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """
        try:
            self._run()
        except RecordingError:
            raise
        except Exception:
            with contextlib.suppress(RecordingError):
                self._write_down()  # what led here
            raise

    def _run(self) -> None:
        self._commands.start()
        while (t := self._next_event()) < self._duration:
            commands = self._commands.take(self.world.t, t, self._write_down)
            self.world.advance(t)
            self._happened.append(self._state())
            for control in commands:
                self._obey(control)
            self._sample(t)
            self._write_down()
            self._apply(t)
            self._report_progress()
        self.world.advance(self._duration)
        self._happened.append(self._state())
        self._write_down()
        self._view.show(last=True)

    @property
    def seed(self) -> int:
        """The scenario's seed."""
        return self._swarm.scenario.seed

    def rejected_by_agents(self) -> dict[str, int]:
        """Payloads that agents dropped, by agent; agents that dropped none are left out."""
        names = self._swarm.names
        return {f"by agent {names[i]}": n for i, n in enumerate(self._rejected) if n}

    def _next_event(self) -> float:
        return min([*self._next_sample, *self._due.values(), self._commands.next])

    def _obey(self, control: Command) -> None:
        """Let a control take effect, and record it."""
        self._recording.write(control)
        self._say(control.t, words(control))
        i = self._faults.obey(control)
        if i is None:
            return
        if not self._faults.silent(i):
            self._next_sample[i] = min(self._next_sample[i], self._resume(i, control))
            return
        self._judge.fell_silent(i, control.t)
        self._next_sample[i] = np.inf
        if control.kind == CommandKind.KILL and i not in self._due:
            self._kill(i)

    def _resume(self, i: int, control: Command) -> float:
        """When agent i may sample again [s]: not before its last input has taken effect."""
        if control.kind != CommandKind.THAW:
            return np.inf
        return max(control.t, float(np.nextafter(self._due.get(i, -np.inf), np.inf)))

    def _kill(self, i: int) -> None:
        latest = tuple(-1 for _ in self._k)
        x = self.world.x.astype("<f8").tobytes()
        last = Sample(VERSION, self._k[i], self.world.t, x, latest, Orders(die=True))
        self._agents.send_sample(i, last)

    def _say(self, t: float, text: str) -> None:
        self._recording.write(Log(t, text))
        self._view.say(t, text)

    def rejected_commands(self) -> dict[str, int]:
        """Commands that were refused, by reason."""
        return dict(self._commands.rejected)

    def _sample(self, t: float) -> None:
        """Hand a sample to every agent due at t; those due together do not hear each other."""
        x = self.world.x.astype("<f8").tobytes()
        latest = tuple(self._latest_before(i, t) for i in range(len(self._k)))
        for i, due in enumerate(self._next_sample):
            if due == t:
                self._judge.sampled(i, t)
                orders = self._faults.orders(i)
                sample = Sample(VERSION, self._k[i], t, x, latest, orders)
                self._agents.send_sample(i, sample)
                self._next_sample[i] = self._clocks[i].after(self._k[i], t)
                self._k[i] += 1
                self._due[i] = t + self._latency

    def _apply(self, t: float) -> None:
        """Await and apply every input that takes effect at t."""
        for i in sorted(i for i, due in self._due.items() if due == t):
            message = self._agents.await_input(i)
            del self._due[i]
            self._rejected[i] = message.rejected
            self.world.apply(i, np.array(message.u))
            self._broadcast[i] = [*self._broadcast[i][-1:], (t, message.k)]
            self._happened.append((i, message))
            if self._faults.condition[i] == Condition.DEAD:
                self._kill(i)

    def _latest_before(self, i: int, t: float) -> int:
        """Sequence number of agent i's last broadcast before t; -1 if none."""
        return max(k for sent, k in self._broadcast[i] if sent < t)

    def _state(self) -> Moment:
        return Moment(self.world.t, self.world.x, self.world.take_seen())

    def _write_down(self) -> None:
        """Judge, record and show what has happened, while the agents compute or time waits."""
        for happening in self._happened:
            if isinstance(happening, Moment):
                self._judge.at_event(happening.t, happening.x, happening.seen)
                peak = self._judge.truth.take_peak()
                self._recording.write(State(happening.t, happening.x.tolist(), peak))
                self._view.saw_state(peak)
                truth = self._judge.truth
                if truth.unsafe and not self._unsafe:
                    self._say(happening.t, f"{truth.worst_pair} left the safe set")
                self._unsafe = truth.unsafe
            else:
                i, message = happening
                self._judge.applied(i, message)
                if self._view.saw_input(i, message):
                    self._say(message.t_apply, f"agent {self._swarm.names[i]}: first backup")
                self._recording.write(self._step_record(*happening))
        self._happened.clear()
        self._view.show()

    def _step_record(self, i: int, message: Input) -> Step:
        names = self._swarm.names
        return Step(
            agent=names[i],
            k=message.k,
            t=message.t,
            t_apply=message.t_apply,
            u=list(message.u),
            origin=message.origin,
            residual=message.residual,
            solve_time=message.solve_time,
            ages=list(message.ages),
            fates=[(names[fate.sender], fate.k, fate.delay) for fate in message.fates],
            u_nom=list(message.u_nom),
        )

    def _report_progress(self) -> None:
        now = time.monotonic()
        if now < self._status_at:
            return
        self._status_at = now + _STATUS_EVERY
        judge = self._judge
        self._agents.publish_status(
            Status(
                version=VERSION,
                t=self.world.t,
                real_time_factor=self.world.t / (now - self._began),
                worst_h=judge.truth.worst_h_tot,
                steps=judge.steps,
                backups=judge.backups,
            )
        )


def waiting_status(hub: Hub) -> Callable[[tuple[str, ...]], None]:
    """A reporter for Hub.wait_for_agents."""

    def report(missing: tuple[str, ...]) -> None:
        hub.publish_status(Status(VERSION, 0.0, 0.0, -np.inf, 0, 0, missing))

    return report
