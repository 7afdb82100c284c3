"""Taking the agents' samples: what each is shown, and who takes none as commands silenced it.

Both clocks sample and obey commands alike; they differ in when.
"""

from collections import Counter
from typing import NamedTuple, Protocol

from phalanx.arrays import Array
from phalanx.faults.clock import AgentClock
from phalanx.faults.commands import Command, FaultState, ProcessChange
from phalanx.faults.onboard import Sensors
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import Swarm
from phalanx.wire.messages import Sample, last_sample
from phalanx_plant.sampling.schedule import Harness, Schedule
from phalanx_plant.sampling.sensing import Contacts, Sensing, Sight
from phalanx_plant.world.events import CommandObeyed


class Processes(Protocol):
    """The agents' processes, as commands act on them."""

    def pause(self, i: int, t: float) -> None:
        """Agent i's process stands still from t [s] on."""

    def resume(self, i: int, t: float) -> None:
        """Agent i's process goes on at t [s]."""

    def kill(self, i: int, order: Sample) -> None:
        """Have agent i's process die of this order."""

    def restart(self, i: int, t: float) -> None:
        """Have another process take the dead agent i's place at t [s]."""


class Taken(NamedTuple):
    """A sample, and what is behind it."""

    sample: Sample
    truthful: bool
    """Whether the agent's sensors told it the true states."""


class Sampling:
    """The samples of all agents of a run."""

    def __init__(self, swarm: Swarm) -> None:
        latency, occurrences = swarm.time.latency, swarm.links.occurrences
        self._clocks = [
            # Its input is due before the next sample, whatever the clock says.
            AgentClock(swarm.clock(i), latency, (o for o in occurrences if o.agent == name))
            for i, name in enumerate(swarm.names)
        ]
        self._harness = Harness(swarm)
        self.schedule = Schedule(self._clocks, latency, self._harness)
        self.sensing = Sensing(swarm)
        states = {member.name: member.dynamics.states for member in swarm.members}
        self._sensors = Sensors(states, swarm.seed, occurrences)
        self._commanded = FaultState(swarm.names)
        self._states = SeenStates(swarm)
        self._contacts = Contacts(len(swarm.members), latency)

    @property
    def faults(self) -> Counter[int]:
        """Samples and inputs on which each declared fault had an effect."""
        of_clocks = sum((clock.faults for clock in self._clocks), Counter[int]())
        return self._harness.faults + self._sensors.faults + of_clocks

    def silent(self, i: int) -> bool:
        """Whether commands have agent i neither sample nor answer."""
        return self._commanded.silent(i)

    def take(self, i: int, t: float, x: Array, sight: Sight, pace: float | None = None) -> Taken:
        """Agent i's sample of the stacked state x, shape (n̄,), at t [s].

        Those due together do not hear each other. pace: of virtual time, in real time.
        """
        awake = sight.without(self.silent)
        since, latest = self._contacts.existing(i, t, awake.seen)
        k = self.schedule.sampled(i, t)
        self._contacts.sampled(i, k, t, awake)
        told = self._sensors.told(i, k, t, x)
        sample = Sample(
            k=k,
            t=t,
            seen=awake.seen,
            x=self._states.packed(told, awake.seen),
            since=since,
            latest=latest,
            hearers=awake.hearers,
            orders=self._commanded.orders(i),
            pace=pace,
        )
        return Taken(sample, told is x)

    def obey(self, command: Command, x: Array, processes: Processes) -> CommandObeyed:
        """Let a command take effect at its time, at the stacked state x."""
        i, effect = self._commanded.obey(command), command.effect
        forgotten: tuple[int, ...] = ()
        if i is None or effect is None:
            return CommandObeyed(command, i)
        if self.silent(i):
            self.schedule.silence(i)
        match effect.process:
            case ProcessChange.DIES:
                # The order travels in a sample, which is not answered.
                k = self.schedule.next_number(i)
                processes.kill(i, last_sample(i, k, command.t, self._states.packed(x, (i,))))
                forgotten = self._contacts.forget(i)
            case ProcessChange.STARTS:
                processes.restart(i, command.t)
                self.schedule.resume(i, command.t)
            case ProcessChange.STOPS:
                processes.pause(i, command.t)
            case ProcessChange.GOES_ON:
                processes.resume(i, command.t)
                self.schedule.resume(i, command.t)
        return CommandObeyed(command, i, forgotten)
