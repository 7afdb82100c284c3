"""Taking the agents' samples: what each is shown, and who takes none as commands silenced it.

Both clocks sample and obey commands alike; they differ in when.
"""

from typing import NamedTuple, Protocol

from phalanx.arrays import Array
from phalanx.faults.commands import Command, FaultState, ProcessChange
from phalanx.faults.onboard import Sensors
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import Swarm
from phalanx.wire.messages import Sample, last_sample
from phalanx_plant.events.events import CommandObeyed
from phalanx_plant.sampling.contacts import Contacts
from phalanx_plant.sampling.schedule import Schedule
from phalanx_plant.sampling.sensing import Sensing, Sight


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

    def __init__(self, swarm: Swarm, schedule: Schedule, faults: FaultState) -> None:
        self.sensing = Sensing(swarm)
        states = {member.name: member.dynamics.states for member in swarm.members}
        self.sensors = Sensors(states, swarm.scenario.seed, swarm.links.occurrences)
        self._schedule, self._faults = schedule, faults
        self._states = SeenStates(swarm)
        self._contacts = Contacts(len(swarm.members), swarm.scenario.time.latency)

    def take(self, i: int, t: float, x: Array, sight: Sight, pace: float | None = None) -> Taken:
        """Agent i's sample of the stacked state x, shape (n̄,), at t [s].

        Those due together do not hear each other. pace: of virtual time, in real time.
        """
        awake = sight.without(self._faults.silent)
        since, latest = self._contacts.existing(i, t, awake.seen)
        k = self._schedule.sampled(i, t)
        self._contacts.sampled(i, k, t, awake)
        told = self.sensors.told(i, k, t, x)
        sample = Sample(
            k=k,
            t=t,
            seen=awake.seen,
            x=self._states.packed(told, awake.seen),
            since=since,
            latest=latest,
            hearers=awake.hearers,
            orders=self._faults.orders(i),
            pace=pace,
        )
        return Taken(sample, told is x)

    def obey(self, command: Command, x: Array, processes: Processes) -> CommandObeyed:
        """Let a command take effect at its time, at the stacked state x."""
        i, effect = self._faults.obey(command), command.effect
        forgotten: tuple[int, ...] = ()
        if i is None or effect is None:
            return CommandObeyed(command, i)
        if self._faults.silent(i):
            self._schedule.silence(i)
        match effect.process:
            case ProcessChange.DIES:
                # The order travels in a sample, which is not answered.
                k = self._schedule.next_number(i)
                processes.kill(i, last_sample(i, k, command.t, self._states.packed(x, (i,))))
                forgotten = self._contacts.forget(i)
            case ProcessChange.STARTS:
                processes.restart(i, command.t)
                self._schedule.resume(i, command.t)
            case ProcessChange.STOPS:
                processes.pause(i, command.t)
            case ProcessChange.GOES_ON:
                processes.resume(i, command.t)
                self._schedule.resume(i, command.t)
        return CommandObeyed(command, i, forgotten)
