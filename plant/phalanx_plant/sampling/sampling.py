"""Times and contents of the agents' samples, and commands to agents, the same for both clocks.

Times follow from the agents' clocks and from the links on board each robot.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from phalanx.faults.commands import Command, FaultState, ProcessChange
from phalanx.faults.onboard import AgentClock, Sensors
from phalanx.messages.kinds import Sample, last_sample
from phalanx.network.link import Kind, Link, RuleError
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx_plant.sampling.sensing import Contacts, Sensing, Visibility
from phalanx_plant.world.events import CommandApplied, SwarmBrokenError


class OnboardLinks:
    """Links on board each robot: from sensor to controller, and from controller to actuator."""

    def __init__(self, swarm: Swarm) -> None:
        self.faults: Counter[int] = Counter()
        """Messages on which each declared fault had an effect."""
        self._sensors = _links(swarm, "sample")
        self._actuators = _links(swarm, "actuation")
        self._end = swarm.scenario.duration

    def brings_sample(self, i: int, tick: int, t: float, now: float) -> bool:
        """Return whether agent i's sample at this tick of its clock, at t [s], arrives.

        now: when this is decided [s].

        A delayed sample is lost: it is used when it is taken, or not at all. After the end of the
        run nothing is lost.
        """
        return t >= self._end or self._delay(self._sensors[i], tick, t, now) == 0.0

    def input_delay(self, i: int, k: int, t: float, now: float) -> float | None:
        """Delay after t [s] of the input for agent i's sample k; None if it is lost.

        now: when this is decided [s].
        """
        return self._delay(self._actuators[i], k, t, now)

    def _delay(self, link: Link, number: int, t: float, now: float) -> float | None:
        if link.free:
            return 0.0
        try:
            delivery = link.fate(number, t, 0.0, now)
        except RuleError as error:
            raise SwarmBrokenError(f"a robot's own link: {error}") from error
        for fault in delivery.faults:
            self.faults[fault] += 1
        return delivery.delay


def _links(swarm: Swarm, kind: Kind) -> list[Link]:
    seeds, models = swarm.seeds, swarm.links
    return [Link(seeds, name, name, models.model(name, name, kind), kind) for name in swarm.names]


class Schedule:
    """The sampling instants of all agents and the instants at which their inputs take effect."""

    def __init__(self, clocks: Sequence[AgentClock], latency: float, links: OnboardLinks) -> None:
        """Begin at t = 0, where all agents sample.

        Args:
            clocks: of the agents.
            latency: from a sample to its input's effect [s].
            links: lose samples, and delay or lose inputs.
        """
        self._clocks, self._latency, self._links = clocks, latency, links
        self._now = 0.0
        """Time of the last sample [s], at which what comes next is decided."""
        self._k = [0 for _ in clocks]
        self._tick = [0 for _ in clocks]
        """Number of each clock's next tick at which no sample is lost."""
        self._next_sample = [0.0 for _ in clocks]
        self._due: dict[int, float] = {}
        """By agent, when its pending input takes effect or is found to be lost [s]."""
        self._lost = [False for _ in clocks]
        """By agent, whether the input for its newest sample is lost."""
        for i in range(len(clocks)):
            self._skip_lost(i)

    def next_event(self) -> float:
        """Time of the earliest sample or input [s]; infinite if there is none."""
        return min([*self._next_sample, *self._due.values()])

    def sampling_at(self, t: float) -> list[int]:
        """The agents that sample at t [s]."""
        return [i for i, due in enumerate(self._next_sample) if due <= t]

    def take_applying(self, t: float) -> list[int]:
        """The agents whose inputs take effect, or are found to be lost, at t [s], in order."""
        applying = sorted([i for i, due in self._due.items() if due <= t])
        for i in applying:
            del self._due[i]
        return applying

    def tick(self, i: int) -> float:
        """Time of the next tick of agent i's clock [s]."""
        return self._next_sample[i]

    def next_number(self, i: int) -> int:
        """The number of agent i's next sample."""
        return self._k[i]

    def sampled(self, i: int, t: float) -> int:
        """Record that agent i samples at t [s], and return the sample's number."""
        k, self._now = self._k[i], t
        self._k[i] = k + 1
        self.skip_tick(i)
        due = t + self._latency
        late = self._links.input_delay(i, k, due, t)
        # By then there may be a newer sample: an input that late is never applied.
        lost = late is None or (late > 0.0 and due + late >= self._next_sample[i])
        self._lost[i], self._due[i] = lost, due if late is None or lost else due + late
        return k

    def due(self, i: int) -> float:
        """Time at which agent i's pending input takes effect, or is found to be lost [s]."""
        return self._due[i]

    def loses_input(self, i: int) -> bool:
        """Return whether the input for agent i's newest sample never reaches its actuator."""
        return self._lost[i]

    def skip_tick(self, i: int) -> None:
        """Go on to the next tick of agent i's clock at which no sample is lost."""
        self._tick_on(i)
        self._skip_lost(i)

    def _tick_on(self, i: int) -> None:
        # The clock continues from its tick, not from when the plant reached it.
        tick, t = self._tick[i], self._next_sample[i]
        self._next_sample[i] = self._clocks[i].after(tick, t, self._now)
        self._tick[i] += 1

    def _skip_lost(self, i: int) -> None:
        brings = self._links.brings_sample
        while not brings(i, self._tick[i], self._next_sample[i], self._now):
            self._tick_on(i)

    def silence(self, i: int) -> None:
        """Let agent i sample no more."""
        self._next_sample[i] = math.inf

    def resume(self, i: int, t: float) -> None:
        """Let agent i sample again at t [s], but not before its last input has taken effect."""
        # Strictly after: a sample at the same instant would count a broadcast not yet sent.
        earliest = max(t, math.nextafter(self._due.get(i, -math.inf), math.inf))
        self._next_sample[i] = min(self._next_sample[i], earliest)


class Processes(Protocol):
    """The agents' processes, as commands control them."""

    def pause(self, i: int, t: float) -> None:
        """Stop agent i's process from t [s] on."""

    def resume(self, i: int, t: float) -> None:
        """Let agent i's process continue at t [s]."""

    def kill(self, i: int, order: Sample) -> None:
        """Make agent i's process exit on receiving this order."""

    def restart(self, i: int, t: float) -> None:
        """Replace the dead agent i's process by another at t [s]."""


class NoProcesses:
    """Processes of agents that run in the plant's own, which sends them no samples meanwhile."""

    def pause(self, i: int, t: float) -> None:
        """Do nothing."""

    def resume(self, i: int, t: float) -> None:
        """Do nothing."""

    def kill(self, i: int, order: Sample) -> None:
        """Do nothing."""

    def restart(self, i: int, t: float) -> None:
        """Do nothing."""


class Sampling:
    """The samples of all agents of a run."""

    def __init__(self, swarm: Swarm) -> None:
        latency, occurrences = swarm.time.latency, swarm.links.occurrences
        self._clocks = [
            # An input is due before the next sample, whatever the clock's faults are.
            AgentClock(swarm.clock(i), latency, (o for o in occurrences if o.agent == name))
            for i, name in enumerate(swarm.names)
        ]
        self._links = OnboardLinks(swarm)
        self.schedule = Schedule(self._clocks, latency, self._links)
        self.sensing = Sensing(swarm)
        states = {member.name: member.dynamics.states for member in swarm.members}
        self._sensors = Sensors(states, swarm.seeds, occurrences)
        self._commanded = FaultState(swarm.names)
        self.silent: set[int] = set()
        """Agents that a command keeps from sampling and answering."""
        self._states = StateCodec(swarm)
        self._contacts = Contacts(len(swarm.members), latency)
        broadcasters = swarm.broadcasters.values()
        self._every = {broadcaster.i: broadcaster.every for broadcaster in broadcasters}
        """Samples from one broadcast of an agent to the next."""

    @property
    def faults(self) -> Counter[int]:
        """Samples and inputs on which each declared fault had an effect."""
        of_clocks = sum((clock.faults for clock in self._clocks), Counter[int]())
        return self._links.faults + self._sensors.faults + of_clocks

    def take(
        self, i: int, t: float, x: Array, visible: Visibility, pace: float | None = None
    ) -> tuple[Sample, bool]:
        """Take agent i's sample of the stacked state x, (n̄,), at t [s]; and whether it is true.

        Agents that sample at the same instant do not receive each other's answers of that instant.
        pace: speed of virtual time, in real time.
        """
        awake = visible.without(self.silent) if self.silent else visible
        ranges = self._contacts.existing(i, t, (*awake.seen, *awake.peers))
        k = self.schedule.sampled(i, t)
        broadcasts = k % self._every.get(i, 1) == 0
        self._contacts.sampled(i, k, t, awake, broadcasts)
        measured = self._sensors.measured(i, k, t, x)
        sample = Sample(
            k=k,
            t=t,
            seen=awake.seen,
            x=self._states.pack(measured, awake.seen),
            senders=tuple([j for j, _, _ in ranges]),
            since=tuple([first for _, first, _ in ranges]),
            latest=tuple([last for _, _, last in ranges]),
            hearers=awake.hearers if broadcasts else (),
            distances=_distances(awake, ranges),
            commands=self._commanded.active_commands(i),
            pace=pace,
        )
        return sample, measured is x

    def apply(self, command: Command, x: Array, processes: Processes) -> CommandApplied:
        """Apply a command at its time, in the stacked state x."""
        i, effect = self._commanded.apply(command), command.effect
        forgotten: tuple[int, ...] = ()
        if i is None or effect is None:
            return CommandApplied(command, i)
        if self._commanded.condition[i].silent:
            self.silent.add(i)
            self.schedule.silence(i)
        else:
            self.silent.discard(i)
        match effect.process:
            case ProcessChange.DIES:
                # The order travels in a sample, which is not answered.
                k = self.schedule.next_number(i)
                processes.kill(i, last_sample(i, k, command.t, self._states.pack(x, (i,))))
                forgotten = self._contacts.forget(i)
            case ProcessChange.STARTS:
                processes.restart(i, command.t)
                self.schedule.resume(i, command.t)
            case ProcessChange.STOPS:
                processes.pause(i, command.t)
            case ProcessChange.GOES_ON:
                processes.resume(i, command.t)
                self.schedule.resume(i, command.t)
        return CommandApplied(command, i, forgotten)


def _distances(visible: Visibility, ranges: Sequence[tuple[int, int, int]]) -> tuple[float, ...]:
    """Return the distance to each sender [m]; empty without peers by radio."""
    if not visible.peers:
        return ()
    to = dict(zip((*visible.seen, *visible.peers), visible.distances, strict=True))
    return tuple([to[j] for j, _, _ in ranges])
