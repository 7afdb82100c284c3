"""Make the agents' samples, and apply commands to agents, in the same way for both clocks."""

from collections import Counter
from typing import Protocol

from phalanx.faults.commands import Command, FaultState, ProcessChange
from phalanx.faults.onboard import AgentClock, Sensors
from phalanx.messages.kinds import Sample, last_sample
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx_plant.sampling.schedule import OnboardLinks, Schedule
from phalanx_plant.sampling.sensing import Contacts, Sensing, Visibility
from phalanx_plant.world.events import CommandApplied


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
        self._silent: set[int] = set()
        self._states = StateCodec(swarm)
        self._contacts = Contacts(len(swarm.members), latency)

    @property
    def faults(self) -> Counter[int]:
        """Samples and inputs on which each declared fault had an effect."""
        of_clocks = sum((clock.faults for clock in self._clocks), Counter[int]())
        return self._links.faults + self._sensors.faults + of_clocks

    def silent(self, i: int) -> bool:
        """Return whether a command keeps agent i from sampling and answering."""
        return i in self._silent

    def take(
        self, i: int, t: float, x: Array, visible: Visibility, pace: float | None = None
    ) -> tuple[Sample, bool]:
        """Take agent i's sample of the stacked state x, (n̄,), at t [s]; and whether it is true.

        Agents that sample at the same instant do not receive each other's answers of that instant.
        pace: speed of virtual time, in real time.
        """
        awake = visible.without(self._silent) if self._silent else visible
        since, latest = self._contacts.existing(i, t, awake.seen)
        k = self.schedule.sampled(i, t)
        self._contacts.sampled(i, k, t, awake)
        measured = self._sensors.measured(i, k, t, x)
        sample = Sample(
            k=k,
            t=t,
            seen=awake.seen,
            x=self._states.pack(measured, awake.seen),
            since=since,
            latest=latest,
            hearers=awake.hearers,
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
            self._silent.add(i)
            self.schedule.silence(i)
        else:
            self._silent.discard(i)
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
