"""The hub: hands out samples, takes answers in, and notices who comes and goes.

In lockstep it waits for agents, in real time it never does.
"""

import contextlib
import logging
import queue
import time
from collections.abc import Callable
from typing import ClassVar, Self, TypeVar

import msgspec

from phalanx.arrays import Array
from phalanx.extensions.registered import extension
from phalanx.profile.stopwatch import Stopwatch
from phalanx.swarm.swarm import Swarm
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Sample, Status, Telemetry
from phalanx.wire.seal import Malformed, Refusals
from phalanx_plant.hub.answers import Answers
from phalanx_plant.hub.joining import Joining, Places
from phalanx_plant.hub.session import Arrivals, PlantSession
from phalanx_plant.world.events import SwarmBrokenError

log = logging.getLogger("phalanx.plant")

_AWAY = 4.0
"""How long an agent may lose the hub before the run begins [s]."""
_GLANCE = 0.2
"""How often a wait looks up to see whether the run was stopped [s]."""

T = TypeVar("T")


class Hub:
    """Samples to agents and answers from them, each checked against what may come next.

    Who is there (Joining) and what was asked and answered (Answers) know of no wire and wait for
    nobody; the session waits for nobody either.
    """

    may_leave: ClassVar[bool]
    """Whether agents that joined may go, and come back."""

    def __init__(
        self,
        swarm: Swarm,
        membership: Membership,
        check_stop: Callable[[], None],
        at_router: bool = False,
    ) -> None:
        """Listen on the membership's endpoint, or meet the others at the router that does.

        check_stop is called at every wait and may raise to end the run. Raises HubError.
        """
        self.refusals = Refusals(log)
        """Payloads dropped."""
        self._timeout, self._names = swarm.time.timeout, swarm.names
        self._check_stop = check_stop
        programs = swarm.programs
        self._alone = {swarm.names.index(who[0]) for who in programs.values() if len(who) == 1}
        """The agents that have a process of their own."""
        self._stopped: set[str] = set()
        self._told = Status()
        """The last status."""
        joining = self._joining = Joining(swarm, self.may_leave)
        answers = self._answers = Answers(swarm, membership.keys, membership.sealer)
        self._arrivals = Arrivals(answers.senders, self.refusals, answers.require_awaited)
        self.session = PlantSession(swarm, membership, at_router)
        self.session.receive(self._arrivals)
        own = membership.certificates
        sign = extension("signer")(own) if own else lambda *_: b""
        places = Places(programs, joining.vacant, joining.digest, sign)
        self.session.give_places(places.answer, self.refusals)
        self.session.announce(joining.digest)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell sending, opening answers, and waiting for reports apart."""
        stopwatch.time(self, "send_sample", "send")
        stopwatch.time(self._answers, "take", "receive")
        stopwatch.time(self, "await_telemetry", "wait")

    def wait_for_agents(self, waiting_for: Callable[[tuple[str, ...]], None]) -> None:
        """Return when every agent has joined with this very scenario.

        Args:
            waiting_for: told who is missing, whenever that changes.

        Raises:
            SwarmBrokenError: an agent does not come, leaves, or runs another scenario.
        """
        deadline = time.monotonic() + self._timeout
        while missing := self._not_there():
            waiting_for(missing)
            self._take_event(deadline, f"agent {', '.join(missing)} did not join")
            for name in self._joining.gone_for(_AWAY):
                raise SwarmBrokenError(f"agent {name} died: see its log")
        self._joining.begin()
        waiting_for(())

    def _not_there(self) -> tuple[str, ...]:
        """Who has not joined, or does not hear yet."""
        if missing := self._joining.missing():
            return missing
        # At a router it may be known later who gets its samples.
        each = zip(self._names, self.session.samples, strict=True)
        return tuple(name for name, samples in each if not samples.heard)

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""
        self._answers.expect(i, sample)
        self.session.samples[i].put(sample)

    def pause(self, i: int, t: float) -> None:
        """Ask for agent i's process to be stopped; one that decides for others too goes on."""
        if i in self._alone:
            self._stopped.add(self._names[i])
            self.publish_status(msgspec.structs.replace(self._told, t=t))

    def resume(self, i: int, t: float) -> None:
        """Ask for agent i's process to go on."""
        self._stopped.discard(self._names[i])
        self.publish_status(msgspec.structs.replace(self._told, t=t))

    def kill(self, i: int, order: Sample) -> None:
        """Have agent i's process die of this order; one that decides for others too lives on."""
        if self._names[i] in self._stopped:
            self.resume(i, order.t)
        if i in self._alone:
            self._joining.dismiss(self._names[i])
            self.session.samples[i].put(order)

    def restart(self, i: int, t: float) -> None:
        """Ask for another process in the dead agent i's place at t [s]."""
        if i in self._alone:
            self._joining.invite(self._names[i])
            wanted = (self._names[i],)
            self.publish_status(Status(t=t, waiting_for=wanted, restart=True))

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """How agent i made its input for sample k.

        Raises SwarmBrokenError: the agent died, or does not report in time.
        """
        return self._await(i, lambda: self._answers.take_telemetry(i, k), "did not report on")

    def publish_status(self, message: Status) -> None:
        """Tell whoever watches how far the run is."""
        self._told = msgspec.structs.replace(message, stopped=tuple(sorted(self._stopped)))
        self.session.status.put(self._told)

    def _await(self, i: int, take: Callable[[], T | None], failed_to: str) -> T:
        deadline = time.monotonic() + self._timeout
        while (found := take()) is None:
            k = self._answers.expected(i)
            self._take_event(deadline, f"agent {self._names[i]} {failed_to} sample {k}")
        return found

    def _take_event(self, deadline: float, complaint: str) -> None:
        self._check_stop()
        if time.monotonic() > deadline:
            dropped = ", ".join(f"{n} {reason}" for reason, n in self.refusals.counts.items())
            because = f" (dropped payloads: {dropped})" if dropped else ""
            hint = "see its log, or raise time.timeout"
            raise SwarmBrokenError(f"{complaint} within {self._timeout:g} s{because}: {hint}")
        with contextlib.suppress(queue.Empty):
            self._handle(*self._arrivals.get(timeout=_GLANCE))

    def _handle_arrived(self) -> None:
        # Those that are there now: more may come faster than they are handled.
        for _ in range(self._arrivals.waiting):
            self._handle(*self._arrivals.get(timeout=0.0))

    def _handle(self, key: str, content: bytes | bool) -> None:
        if isinstance(content, bool):
            if broken := self._joining.on_token(key, content):
                raise SwarmBrokenError(broken)
            return
        try:
            failure = self._answers.take(key, content)
        except Malformed as reason:
            self.refusals.add(key, reason)
        else:
            # Where agents may leave, the run goes on without one that answers no more.
            if failure is not None and not self.may_leave:
                raise SwarmBrokenError(failure)


class LockstepHub(Hub):
    """A hub of agents that are all waited for: the run cannot go on without one."""

    may_leave = False

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell waiting for answers apart, too."""
        super().time(stopwatch)
        stopwatch.time(self, "await_input", "wait")

    def await_input(self, i: int) -> Array:
        """The input that agent i's actuator gets for its last sample, shape (m_i,).

        Raises:
            SwarmBrokenError: the agent died, or does not answer in time.
        """
        return self._await(i, lambda: self._answers.take_input(i), "did not answer")

    def take_input(self, i: int) -> Array | None:
        """The same, if it has come. Raises SwarmBrokenError if an agent died."""
        self._handle_arrived()
        return self._answers.take_input(i)

    def pause(self, i: int, t: float) -> None:
        """Once agent i has said all that it had to say. Raises SwarmBrokenError."""
        self._await_report(i)
        super().pause(i, t)

    def kill(self, i: int, order: Sample) -> None:
        """Once agent i has said all that it had to say. Raises SwarmBrokenError."""
        self._await_report(i)
        super().kill(i, order)

    def restart(self, i: int, t: float) -> None:
        """Return when the new process is there.

        Raises SwarmBrokenError: it does not come, or runs another scenario.
        """
        if i not in self._alone:
            return
        name, deadline = self._names[i], time.monotonic() + self._timeout
        self._joining.invite(name)
        while self._joining.has(name):
            self._take_event(deadline, f"agent {name} did not die")
        while not self._joining.has(name):
            super().restart(i, t)
            self._take_event(deadline, f"agent {name} did not join again")
        self.session.samples[i].wait_until_heard(self._timeout)

    def _await_report(self, i: int) -> None:
        self._await(i, lambda: self._answers.complete(i) or None, "did not report on")


class RealTimeHub(Hub):
    """A hub of agents that come and go while the run goes on."""

    may_leave = True

    @property
    def waiting(self) -> int:
        """How much has come that was not handled yet."""
        return self._arrivals.waiting

    def listen(self, seconds: float) -> None:
        """Handle what comes, for so long [s of wall time], or until something has come."""
        self._check_stop()
        with contextlib.suppress(queue.Empty):
            self._handle(*self._arrivals.get(timeout=min(max(seconds, 0.0), _GLANCE)))
            self._handle_arrived()

    def take_reported(self, i: int) -> Array | None:
        """Agent i's input, shape (m_i,), if it has come, and its report too."""
        return self._answers.take_reported(i)

    def take_changes(self) -> list[tuple[int, bool]]:
        """Who is not to be reached any more, and who is back, since last asked: (i, is back)."""
        return self._joining.take_changes()
