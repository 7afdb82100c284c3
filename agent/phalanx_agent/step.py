"""One control step: a sample in, and out what the actuator, the peers and the plant get of it."""

import time
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.faults.commands import Orders
from phalanx.network.inbox import BroadcastInbox, Claim, Existing, Fate
from phalanx.network.link import Link, RuleError
from phalanx.schema.fields import CONTROLLER
from phalanx.swarm.finite import mistake_at
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.asked import MistakenMethodError, in_words
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.rows.information import ReceivedInput
from phalanx.wire.membership import Membership
from phalanx.wire.messages import (
    LONGEST_FAILURE,
    MAX_BYTES,
    Actuation,
    Broadcast,
    Sample,
    Telemetry,
)
from phalanx.wire.seal import Malformed
from phalanx_agent.clock import LOCKSTEP, VirtualClock, clock_of
from phalanx_agent.controller import (
    CentralisedController,
    CentralisedPart,
    Controller,
    DistributedController,
    StepResult,
)

_AT_HOME = Membership("in-process", endpoint="")
"""Where nothing is sent, damage is done to what would have been."""


_FLOAT, _INT, _HEAD = 9, 5, 3
"""At most so long are a float, an integer and what begins an array, in a message [bytes]."""


class Answer(NamedTuple):
    """What an agent makes of a sample: for its actuator, its peers and the plant."""

    actuation: Actuation
    broadcasts: Mapping[int, Broadcast]
    """What each peer that hears the agent is told, by index; a liar tells them different things."""
    telemetry: Telemetry
    waits: bool = True
    """Whether each of these peers is waited for."""


class Accepted(NamedTuple):
    """A sample that may be the plant's next, taken apart."""

    sample: Sample
    x: Array
    """Stacked state, shape (n̄,); NaN where it is not seen."""
    existing: dict[int, Existing]
    """Which broadcasts it counts, by sender."""


class StepFailedError(RuntimeError):
    """A sample that an agent cannot answer; the message says whose code failed, where and how."""

    def __init__(self, message: str, sample: Sample) -> None:
        super().__init__(message)
        self.sample = sample


class ControlStep:
    """Agent i beside its controller: what may come, what it has received, what it says."""

    def __init__(
        self,
        rows: SafetyRows,
        i: int,
        controller: Controller | None = None,
        membership: Membership = _AT_HOME,
    ) -> None:
        """controller: agent i's own unless said otherwise. membership: of its program."""
        swarm = rows.swarm
        self.swarm, self._rows = swarm, rows
        self.i = i
        self.name = swarm.names[i]
        self._heard = frozenset(swarm.heard_by(i))
        self.inbox = BroadcastInbox(swarm.heard_by(i), self._link)
        self.rejected = 0
        """Payloads dropped so far."""
        self._states = SeenStates(swarm)
        self._keys, self._sealer = membership.keys, membership.sealer
        self._next: int | None = None
        """The sample that has to come next; None before the first."""
        self._clock: VirtualClock = LOCKSTEP
        self._orders: Orders | None = None
        self._latency = swarm.time.latency
        self._lies = swarm.links.lies(self.name)
        self.most_fates = _most_fates(swarm)
        """In one report."""
        self._untold: tuple[Fate, ...] = ()
        """Fates that the plant has not been told of yet."""
        self._past: deque[tuple[float, ...]] = deque(maxlen=self._lies.reach)
        """Inputs that lies may look back at, the newest last."""
        self._controller: Controller = controller or DistributedController(rows, i)

    def accept_sample(self, sample: Sample) -> Accepted:
        """Check a sample against what the plant may send next. Raises Malformed.

        The first one may have any number: who takes over from an agent that died joins in the
        middle of a run, with an empty inbox.
        """
        if not len(sample.seen) == len(sample.since) == len(sample.latest):
            raise Malformed("wrong size")
        try:
            states = self._states.of(sample.x, sample.seen)
        except ValueError as error:
            raise Malformed("wrong size") from error
        largest = np.abs(np.frombuffer(sample.x, dtype="<f8")).max(initial=0.0)
        if not largest <= LARGEST:
            raise Malformed("too large" if np.isfinite(largest) else "not finite")
        existing = _existing(sample)
        if self.i not in states or not self._heard.issuperset(existing):
            raise Malformed("wrong agents")
        if self.i in sample.hearers or not states.keys() >= set(sample.hearers):
            raise Malformed("wrong agents")
        first, clock = self._next is None, clock_of(sample)
        # In real time some are lost, with the hub that they were on.
        skipped = sample.k - (self._next or 0)
        if skipped < 0 or (skipped and not first and clock.waits):
            raise Malformed("out of order")
        if first and sample.k > 0:
            self.inbox.join_at(existing)
        self._next = sample.k + 1
        self._clock = clock
        return Accepted(sample, self._states.stacked(states), existing)

    def lacks_broadcasts(self, accepted: Accepted) -> bool:
        """Whether a broadcast that a sample counts has yet to arrive."""
        return self._clock.lacks(self.inbox, accepted.existing)

    def withheld(self, accepted: Accepted) -> StepFailedError:
        """What to say of a sample that counts broadcasts which do not come."""
        lacking = self.inbox.lacking(accepted.existing).items()
        names, k = self.swarm.names, accepted.sample.k
        whose = ", ".join(f"{numbers[0]} of agent {names[j]}" for j, numbers in lacking)
        words = (
            f"agent {self.name} waits at sample {k} for what others put: broadcast {whose} did not "
            "come. Its sender withholds it, or does not reach this agent: see the sender's log"
        )
        return StepFailedError(words, accepted.sample)

    def accept_broadcast(self, sender: str, message: Broadcast) -> None:
        """Put another agent's broadcast into the inbox. Raises Malformed."""
        speaker = self.swarm.speakers.get(sender)
        if speaker is None or speaker.i not in self._heard:
            raise Malformed("unknown sender")
        if message.k >= speaker.most:
            # More of them would only fill the memory.
            raise Malformed("from the future")
        if len(message.u) != speaker.inputs:
            raise Malformed("wrong size")
        if not self.inbox.put(speaker.i, message, self._clock.now()):
            raise Malformed("out of order")

    def __call__(self, accepted: Accepted) -> Answer:
        """Answer a sample. In lockstep the inbox must have every broadcast that it counts.

        Raises StepFailedError.
        """
        sample = accepted.sample
        try:
            return self._answer(accepted)
        except MistakenMethodError as error:
            words = error.told(f"agent {error.agent or self.name} at sample {sample.k}")
            raise StepFailedError(words, sample) from error
        except Exception as error:
            raise StepFailedError(self._why_failed(accepted, error), sample) from error

    def _why_failed(self, accepted: Accepted, error: Exception) -> str:
        """Whose expression has no value at a sample, if that may be why; else the error."""
        sample = accepted.sample
        if isinstance(error, ArithmeticError | ValueError):
            mistake = mistake_at(self._rows, self.i, accepted.x, sample.seen)
            if mistake is not None:
                return mistake.told(f"agent {self.name} at sample {sample.k}")
        reason = error if isinstance(error, RuleError) else in_words(error)
        return f"agent {self.name} failed at sample {sample.k}: {reason}"

    def _answer(self, accepted: Accepted) -> Answer:
        began, (sample, x, _) = time.perf_counter(), accepted
        self.obey(sample.orders)
        self._untold += self._decide_fates(accepted)
        fates, self._untold = self._untold[: self.most_fates], self._untold[self.most_fates :]
        received = self.inbox.received()
        result = self.decide(x, sample.seen, sample.t, received)
        u, t_apply = tuple(result.decision.u.tolist()), sample.t + self._latency
        return Answer(
            Actuation(k=sample.k, t_apply=t_apply, u=u),
            self._broadcasts(sample, Claim(t_apply, u)),
            Telemetry(
                k=sample.k,
                report=result.report(time.perf_counter() - began),
                ages=tuple((l, sample.t - received[l].t_apply) for l in result.used),
                fates=fates,
                rejected=self.rejected,
                received=self._clock.reported(received),
            ),
            waits=self._clock.waits,
        )

    def decide(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """What the controller makes of the stacked state x, shape (n̄,), sampled at t [s]."""
        return self._controller(x, seen, t, received)

    def _broadcasts(self, sample: Sample, truth: Claim) -> dict[int, Broadcast]:
        if not self._lies.declared:
            same = Broadcast(k=sample.k, t_apply=truth.t_apply, u=truth.u)
            return dict.fromkeys(sample.hearers, same)
        past, names = self._past, self.swarm.names
        told = {
            l: self._lies.tell(
                names[l], sample.k, truth, lambda ago: past[-ago] if ago <= len(past) else None
            )
            for l in sample.hearers
        }
        past.append(truth.u)
        return {
            l: Broadcast(k=sample.k, t_apply=claim.t_apply, u=claim.u)
            for l, (claim, _) in told.items()
        }

    def _decide_fates(self, accepted: Accepted) -> tuple[Fate, ...]:
        sample, x, existing = accepted
        fates = self.inbox.advance(
            self._clock.counted(self.inbox, existing),
            sample.t,
            lambda sender: self.swarm.apart(x, self.i, sender),
        )
        for sender, message in self.inbox.take_corrupt():
            sent = Broadcast(k=message.k, t_apply=message.t_apply, u=message.u)
            key = self._keys.broadcast(self.swarm.names[sender], self.name)
            try:
                self._sealer.open_damaged(key, sent, sent.k)
            except Malformed:
                self.rejected += 1
        return fates

    def _link(self, sender: int) -> Link:
        swarm, receiver = self.swarm, self.name
        model = swarm.links.model(swarm.names[sender], receiver)
        return Link(swarm.seed, swarm.names[sender], receiver, model)

    def obey(self, orders: Orders | None) -> None:
        """Do from now on as commands ask."""
        if orders is None or orders == self._orders:
            return
        turned = orders.adversary and not (self._orders and self._orders.adversary)
        self._orders = orders
        self.inbox.override_links(orders.loss, orders.delay)
        if turned:
            self._controller = self._controller.turned()


def control_steps(
    rows: SafetyRows, name: str, membership: Membership = _AT_HOME
) -> list[ControlStep]:
    """The steps of one process: an agent's own, or the controller's for every normal agent."""
    if name != CONTROLLER:
        return [ControlStep(rows, rows.swarm.names.index(name), membership=membership)]
    whole = CentralisedController(rows)
    return [ControlStep(rows, i, CentralisedPart(whole, i), membership) for i in rows.swarm.normal]


def _most_fates(swarm: Swarm) -> int:
    """How many fates a report holds beside all else that may be in it: with more it may be too
    large, and after a pause there may be many."""
    u = _HEAD + _FLOAT * max(len(member.dynamics.inputs) for member in swarm.members)
    age, received = _HEAD + _INT + _FLOAT, _HEAD + _INT + _FLOAT + u
    else_in_it = 200 + LONGEST_FAILURE + u + len(swarm.members) * (age + received)
    faults = _HEAD + _INT * len(swarm.links.declared)
    fate = _HEAD + _INT + _INT + _FLOAT + faults + _HEAD + _FLOAT + u
    return max((MAX_BYTES - else_in_it) // fate, 1)


def _existing(sample: Sample) -> dict[int, Existing]:
    """Which broadcasts a sample counts, by sender."""
    counted = zip(sample.seen, sample.since, sample.latest, strict=True)
    return {j: Existing(since, latest) for j, since, latest in counted if since >= 0}
