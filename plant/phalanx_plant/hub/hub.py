"""The hub: sends samples, receives answers, and tracks who has joined.

In lockstep it waits for agents, in real time it does not.
"""

import contextlib
import logging
import queue
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import ClassVar, Self, TypeVar

import msgspec

from phalanx.messages.keys import kind_and_name
from phalanx.messages.kinds import Sample, Status, Telemetry
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed, Refusals
from phalanx.swarm.attack import Attack
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx_plant.hub.answers import Answers
from phalanx_plant.hub.session import IncomingQueue, PlantSession
from phalanx_plant.world.events import SwarmBrokenError

log = logging.getLogger("phalanx.plant")

_AWAY = 4.0
"""Time for which an agent may lose the connection before the run begins [s]."""
_POLL = 0.2
"""While waiting, period of checking whether the run was stopped [s]."""

T = TypeVar("T")


class Joining:
    """The agents of one run, as their liveliness tokens come and go."""

    def __init__(
        self, swarm: Swarm, may_leave: bool, now: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin without members.

        Args:
            swarm: of the scenario.
            may_leave: whether agents that joined may leave, and come back.
            now: the wall clock [s].
        """
        self.digest = swarm.digest
        """Of the scenario; an agent that runs another one is rejected."""
        self._names, self._may_leave = swarm.names, may_leave
        self._now = now
        self._joined: set[str] = set()
        self._dismissed: set[str] = set()
        """Agents that were ordered to exit, and are still there."""
        self._begun = False
        self._gone: dict[str, float] = {}
        """Wall time at which an agent that had joined was lost [s]."""
        self._changes: list[tuple[int, bool, str]] = []
        self._failures: dict[str, str] = {}
        """What agents reported that may leave, and have not yet."""

    def begin(self) -> None:
        """Begin the run: unless agents may leave, losing one is now an error."""
        self._begun = True

    def gone_for(self, seconds: float) -> list[str]:
        """Agents that joined, and were lost at least this long ago."""
        now = self._now()
        return [name for name, since in self._gone.items() if now > since + seconds]

    def missing(self) -> tuple[str, ...]:
        """Agents that have not joined yet."""
        return tuple(name for name in self._names if name not in self._joined)

    def has(self, name: str) -> bool:
        """Return whether an agent has joined and is not lost."""
        return name in self._joined

    def dismiss(self, name: str) -> None:
        """Expect that an agent exits, as it was ordered to."""
        self._dismissed.add(name)

    def exits(self, name: str) -> bool:
        """Return whether an agent was ordered to exit, and has not yet."""
        return name in self._dismissed

    def on_failure(self, name: str, failure: str) -> str | None:
        """Handle an agent's report that it failed; return it if the run needs every agent."""
        if not self._may_leave:
            return failure
        self._failures[name] = failure
        return None

    def take_changes(self) -> list[tuple[int, bool, str]]:
        """Return agents that were lost or came back since the last call: (i, is back, why)."""
        changes, self._changes = self._changes, []
        return changes

    def on_token(self, key: str, alive: bool) -> str | None:
        """Handle a token's appearance or disappearance; return an error message, or None."""
        (_, name), digest = kind_and_name(key), key.rsplit("/", 1)[-1]
        if name not in self._names:
            return None
        if name in self._joined and self._may_leave:
            if digest == self.digest:
                why = self._failures.pop(name, "")
                self._changes.append((self._names.index(name), alive, why))
            return None
        if name in self._joined:
            if alive or digest != self.digest:
                return None
            self._joined.remove(name)
            if name in self._dismissed:
                self._dismissed.remove(name)
                return None
            if self._begun:
                return f"agent {name} died: see its log"
            self._gone[name] = self._now()
            return None
        if alive and digest != self.digest:
            return (
                f"agent {name} runs another scenario, seed or version (digest {digest[:64]!r}, "
                f"here {self.digest}): start it with the plant's --scenario, --seed and --set"
            )
        if alive:
            self._joined.add(name)
            self._gone.pop(name, None)
        return None


class Countdown:
    """The time left of a wait, without what passes while this process is stopped."""

    def __init__(self, seconds: float) -> None:
        self._remaining, self._looked = seconds, time.monotonic()

    def ended(self) -> bool:
        """Return whether nothing is left; asked once in each poll."""
        now = time.monotonic()
        # A poll that took longer was interrupted (Ctrl-Z): agents' answers may be on their way.
        self._remaining -= min(now - self._looked, 2.0 * _POLL)
        self._looked = now
        return self._remaining < 0.0


class Hub:
    """Sends samples to agents, and receives their answers.

    Membership (Joining) and the state of samples and answers (Answers) do no I/O, and no part but
    the hub itself waits.
    """

    may_leave: ClassVar[bool]
    """Whether agents that joined may leave, and come back."""

    def __init__(
        self,
        swarm: Swarm,
        membership: Membership,
        check_stop: Callable[[], None],
        at_router: bool = False,
        attacks: Mapping[int, Attack] = MappingProxyType({}),
    ) -> None:
        """Listen on the membership's endpoint, or connect to the router that does.

        check_stop is called at every wait and may raise to end the run. attacks: as Answers takes
        them. Raises HubError.
        """
        self.refusals = Refusals(log)
        """Payloads dropped."""
        self._timeout, self._names = swarm.time.timeout, swarm.names
        self._check_stop = check_stop
        programs = swarm.programs
        self._alone = {
            swarm.names.index(agents[0]) for agents in programs.values() if len(agents) == 1
        }
        """The agents that have a process of their own."""
        self._stopped: set[str] = set()
        self._mute: set[int] = set()
        """Agents that did not answer in time: what else is missing of them is not waited for."""
        self._status = Status()
        """The last status."""
        joining = self._joining = Joining(swarm, self.may_leave)
        answers = self._answers = Answers(swarm, membership.keys, membership.sealer, attacks)
        self._incoming = IncomingQueue(answers.senders, self.refusals, answers.require_pending)
        self.session = PlantSession(swarm, membership, at_router)
        self.session.receive(self._incoming)
        self.session.announce(joining.digest)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    def wait_for_agents(self, waiting_for: Callable[[tuple[str, ...]], None]) -> None:
        """Return when every agent has joined with this scenario.

        Args:
            waiting_for: called with the names of missing agents.

        Raises:
            SwarmBrokenError: an agent does not join, leaves, or runs another scenario.
        """
        countdown = Countdown(self._timeout)
        while missing := self._missing():
            waiting_for(missing)
            self._take_event(countdown, f"agent {', '.join(missing)} did not join")
            for name in self._joining.gone_for(_AWAY):
                raise SwarmBrokenError(f"agent {name} died: see its log")
        self._joining.begin()
        waiting_for(())

    def _missing(self) -> tuple[str, ...]:
        """Agents that have not joined, or do not receive samples yet."""
        if missing := self._joining.missing():
            return missing
        # A router may announce subscriptions later than tokens.
        publishers = zip(self._names, self.session.samples, strict=True)
        return tuple(name for name, samples in publishers if not samples.heard)

    def send_sample(self, i: int, sample: Sample) -> None:
        """Send agent i its sample."""
        self._answers.expect(i, sample)
        self.session.samples[i].put(sample)

    def pause(self, i: int, t: float) -> None:
        """Request that agent i's process be stopped, unless it decides for other agents too."""
        if i in self._alone:
            self._stopped.add(self._names[i])
            self.publish_status(msgspec.structs.replace(self._status, t=t))

    def resume(self, i: int, t: float) -> None:
        """Request that agent i's process continue."""
        self._stopped.discard(self._names[i])
        self.publish_status(msgspec.structs.replace(self._status, t=t))

    def kill(self, i: int, order: Sample) -> None:
        """Order agent i's process to exit, unless it decides for other agents too."""
        if self._names[i] in self._stopped:
            self.resume(i, order.t)
        if i in self._alone:
            self._joining.dismiss(self._names[i])
            self.session.samples[i].put(order)

    def restart(self, i: int, t: float) -> None:
        """Request another process for the dead agent i at t [s]."""
        if i in self._alone:
            self.publish_status(Status(t=t, waiting_for=(self._names[i],), restart=True))

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Wait for agent i's report on its sample k.

        Raises SwarmBrokenError: the agent died, or does not report in time.
        """
        return self._await(i, lambda: self._answers.take_telemetry(i, k), "did not report on")

    def publish_status(self, message: Status) -> None:
        """Publish the run's progress."""
        self._status = msgspec.structs.replace(message, stopped=tuple(sorted(self._stopped)))
        self.session.status.put(self._status)

    def _await(self, i: int, take: Callable[[], T | None], failed_to: str) -> T:
        countdown = Countdown(0.0 if i in self._mute else self._timeout)
        while (answer := take()) is None:
            k = self._answers.expected(i)
            try:
                self._take_event(countdown, f"agent {self._names[i]} {failed_to} sample {k}")
            except SwarmBrokenError:
                self._mute.add(i)
                raise
        return answer

    def _take_event(self, countdown: Countdown, complaint: str) -> None:
        self._check_stop()
        if countdown.ended():
            dropped = ", ".join(f"{n} {reason}" for reason, n in self.refusals.counts.items())
            because = f" (dropped payloads: {dropped})" if dropped else ""
            hint = "see its log, or raise time.timeout"
            raise SwarmBrokenError(f"{complaint} within {self._timeout:g} s{because}: {hint}")
        with contextlib.suppress(queue.Empty):
            self._handle(*self._incoming.get(timeout=_POLL))

    def _handle_arrived(self) -> None:
        # Those of now only: more may arrive faster than they are handled.
        for _ in range(self._incoming.waiting):
            self._handle(*self._incoming.get(timeout=0.0))

    def _handle(self, key: str, content: bytes | bool) -> None:
        if isinstance(content, bool):
            if broken := self._joining.on_token(key, content):
                raise SwarmBrokenError(broken)
            return
        try:
            failure = self._answers.accept(key, content)
        except Malformed as reason:
            self.refusals.add(key, reason)
        else:
            # If agents may leave, the run continues without one that fails.
            if failure and (broken := self._joining.on_failure(*failure)):
                raise SwarmBrokenError(broken)


class LockstepHub(Hub):
    """A hub for lockstep, where the run needs every agent."""

    may_leave = False

    def await_input(self, i: int) -> Array:
        """Wait for agent i's input for its last sample, shape (m_i,).

        Raises:
            SwarmBrokenError: the agent died, or does not answer in time.
        """
        return self._await(i, lambda: self._answers.take_input(i), "did not answer")

    def take_input(self, i: int) -> Array | None:
        """Return the same, if it has arrived. Raises SwarmBrokenError if an agent died."""
        self._handle_arrived()
        return self._answers.take_input(i)

    def pause(self, i: int, t: float) -> None:
        """Pause agent i after its pending messages have arrived. Raises SwarmBrokenError."""
        self._await_report(i)
        super().pause(i, t)

    def kill(self, i: int, order: Sample) -> None:
        """Kill agent i after its pending messages have arrived. Raises SwarmBrokenError."""
        self._await_report(i)
        super().kill(i, order)

    def restart(self, i: int, t: float) -> None:
        """Return when the new process has joined.

        Raises SwarmBrokenError: it does not join, or runs another scenario.
        """
        if i not in self._alone:
            return
        name, countdown = self._names[i], Countdown(self._timeout)
        while self._joining.exits(name):
            self._take_event(countdown, f"agent {name} did not die")
        while not self._joining.has(name):
            super().restart(i, t)
            self._take_event(countdown, f"agent {name} did not join again")
        self.session.samples[i].wait_until_heard(self._timeout)

    def _await_report(self, i: int) -> None:
        self._await(i, lambda: self._answers.complete(i) or None, "did not report on")


class RealTimeHub(Hub):
    """A hub for real time, where agents may leave and come back during the run."""

    may_leave = True

    @property
    def waiting(self) -> int:
        """Number of messages that have arrived and are not handled."""
        return self._incoming.waiting

    def listen(self, seconds: float) -> None:
        """Wait up to `seconds` [s of wall time] for messages, and handle those that arrived."""
        self._check_stop()
        with contextlib.suppress(queue.Empty):
            self._handle(*self._incoming.get(timeout=min(max(seconds, 0.0), _POLL)))
            self._handle_arrived()

    def take_reported(self, i: int) -> Array | None:
        """Return agent i's input, shape (m_i,), if it and its report have arrived."""
        return self._answers.take_reported(i)

    def take_changes(self) -> list[tuple[int, bool, str]]:
        """Return agents that were lost or came back since the last call: (i, is back, why)."""
        return self._joining.take_changes()
