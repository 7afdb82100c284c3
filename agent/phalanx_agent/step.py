"""One control step: from a sample to the messages for actuator, peers and plant."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from msgspec import Struct

from phalanx.faults.commands import ActiveCommands
from phalanx.messages.kinds import (
    LONGEST_FAILURE,
    MAX_BYTES,
    Actuation,
    Broadcast,
    Sample,
    StepFailedError,
    Telemetry,
)
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed
from phalanx.network.inbox import (
    AnnouncedInput,
    BroadcastInbox,
    BroadcastRange,
    Conviction,
    DeliveryReport,
    SentInput,
    Statement,
)
from phalanx.network.link import Link, RuleError
from phalanx.schema.fields import CONTROLLER
from phalanx.schema.registry import part_of_agent
from phalanx.swarm.mistakes import mistake_at
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import Broadcaster, Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import error_line
from phalanx.theory.rows.information import ReceivedInput
from phalanx_agent.clock import LOCKSTEP, Clock, clock_of
from phalanx_agent.controller import (
    AgentController,
    DistributedController,
    FirstController,
    HijackedController,
    StepResult,
)

_AT_HOME = Membership("in-process", endpoint="")
"""The in-process engine's, which sends nothing but seals what is to be corrupted."""

_FLOAT, _INT, _HEAD = 9, 5, 3
"""Longest encoding of a float, an integer and the beginning of an array in msgpack [bytes]."""


class Answer(Struct, frozen=True):
    """An agent's answer to a sample."""

    actuation: Actuation
    broadcasts: Mapping[int, Broadcast]
    """By index of the peer; a lying agent may send them different ones."""
    telemetry: Telemetry
    waits: bool = True
    """Whether the run waits for each of these peers."""


class Accepted(Struct, frozen=True):
    """A validated and decoded sample."""

    sample: Sample
    x: Array
    """Stacked state, shape (n̄,); NaN for agents that are not seen."""
    existing: dict[int, BroadcastRange]
    """The broadcasts that it counts, by sender."""
    distances: Mapping[int, float] = MappingProxyType({})
    """To each sender [m], if some are not seen."""


class ControlStep:
    """Agent i's control step: validation of samples and broadcasts, the inbox, and the answer."""

    def __init__(
        self,
        rows: SafetyRows,
        i: int,
        controller: FirstController | None = None,
        membership: Membership = _AT_HOME,
    ) -> None:
        """controller: by default agent i's own. membership: of its program."""
        swarm = rows.swarm
        self.swarm, self._rows = swarm, rows
        self.i = i
        self.name = swarm.names[i]
        self._heard, self._peers = frozenset(swarm.heard_by(i)), frozenset(swarm.peers(i))
        self._broadcasters = {b.i: b for b in swarm.broadcasters.values()}
        peers = {l: self._broadcasters[l].every for l in self._peers}
        radio = swarm.groups[i].radio
        self._relays, stamp_error = (radio.relays, radio.stamp_error) if radio else (0, 0.0)
        self.inbox = BroadcastInbox(swarm.heard_by(i), self._link, peers, stamp_error)
        self.rejected = 0
        """Payloads dropped so far."""
        self._states = StateCodec(swarm)
        self._keys, self._sealer = membership.keys, membership.sealer
        self._next: int | None = None
        """The number of the next sample; None before the first."""
        self._clock: Clock = LOCKSTEP
        self._commands: ActiveCommands | None = None
        self._latency = swarm.time.latency
        self._lies = swarm.links.lies(self.name)
        self.most_fates = _most_fates(swarm)
        """Most fates in one report."""
        self._unreported: tuple[DeliveryReport, ...] = ()
        """Fates that are decided and not yet reported to the plant."""
        self._past: deque[AnnouncedInput] = deque(maxlen=self._lies.steps_back)
        """What lies may repeat, the newest last."""
        watches = swarm.safety.watch and not swarm.members[i].adversary
        self._watch: Callable[..., list[Conviction]] | None = (
            part_of_agent("safety.watch")(swarm, i) if watches else None
        )
        first = controller or DistributedController(rows, i)
        self._controller: AgentController = first
        self._as_adversary = first.as_adversary

    def accept_sample(self, sample: Sample) -> Accepted:
        """Validate and decode the next sample. Raises Malformed.

        The first one may have any number: the successor of an agent that died joins in the middle
        of a run, with an empty inbox.
        """
        try:
            x = self._states.unpack(sample.x, sample.seen)
            counted = zip(sample.senders, sample.since, sample.latest, strict=True)
            existing = {j: (since, latest) for j, since, latest in counted}
            distances = dict(zip(sample.senders, sample.distances or sample.senders, strict=True))
        except ValueError as error:
            raise Malformed("wrong size") from error
        largest = np.maximum.reduce(np.abs(np.frombuffer(sample.x, dtype="<f8")), initial=0.0)
        if not largest <= LARGEST:
            raise Malformed("too large" if np.isfinite(largest) else "not finite")
        if self.i not in sample.seen or not self._heard >= set(existing):
            raise Malformed("wrong agents")
        reached = {*sample.seen, *self._peers}
        if self.i in sample.hearers or not reached >= {*sample.hearers, *existing}:
            raise Malformed("wrong agents")
        first, clock = self._next is None, clock_of(sample)
        # In real time samples may be lost, when a router is.
        skipped = sample.k - (self._next or 0)
        if skipped < 0 or (skipped and not first and clock.waits):
            raise Malformed("out of order")
        if first and sample.k > 0:
            self.inbox.join_at(existing)
        self._next = sample.k + 1
        self._clock = clock
        return Accepted(sample, x, existing, distances if sample.distances else {})

    def lacks_broadcasts(self, accepted: Accepted) -> bool:
        """Return whether a broadcast that a sample counts has yet to arrive."""
        return self._clock.lacks(self.inbox, accepted.existing)

    def broadcasts_missing(self, accepted: Accepted) -> StepFailedError:
        """Make the error of a sample that counts broadcasts which do not come."""
        lacking = self.inbox.missing(accepted.existing).items()
        names, k = self.swarm.names, accepted.sample.k
        whose = ", ".join(f"{numbers[0]} of agent {names[j]}" for j, numbers in lacking)
        words = (
            f"agent {self.name} waits at sample {k} for what others put: broadcast {whose} did not "
            "come. Its sender withholds it, or cannot reach this agent: see the sender's log"
        )
        return StepFailedError(words, accepted.sample)

    def accept_broadcast(self, sender: str, message: Broadcast) -> None:
        """Put another agent's broadcast into the inbox. Raises Malformed."""
        broadcaster = self.swarm.broadcasters.get(sender)
        if broadcaster is None or broadcaster.i not in self._heard:
            raise Malformed("unknown sender")
        if message.k >= broadcaster.most:
            # Accepting more would fill the memory.
            raise Malformed("from the future")
        if not self._well_formed(broadcaster, message):
            raise Malformed("wrong size")
        if not self.inbox.put(broadcaster.i, message, self._clock.now()):
            raise Malformed("out of order")

    def _well_formed(self, broadcaster: Broadcaster, message: Broadcast) -> bool:
        """Return whether a broadcast has the sizes of its sender's, and so have its relays."""
        if len(message.relays) > broadcaster.relays:
            return False
        others = ((self._broadcasters.get(s.sender), s) for s in message.relays)
        statements: list[tuple[Broadcaster | None, SentInput]] = [(broadcaster, message), *others]
        return all(
            of is not None
            and len(s.u) == of.inputs
            and s.k < of.most
            and len(s.x) == len(s.z) == of.states
            for of, s in statements
        )

    def __call__(self, accepted: Accepted) -> Answer:
        """Answer a sample. In lockstep the inbox must have every broadcast that it counts.

        Raises StepFailedError.
        """
        sample = accepted.sample
        try:
            return self._answer(accepted)
        except Exception as error:
            raise StepFailedError(self._why_failed(accepted, error), sample) from error

    def _why_failed(self, accepted: Accepted, error: Exception) -> str:
        """Name the expression that has no value at a sample, if one has none; else the error."""
        sample = accepted.sample
        if isinstance(error, ArithmeticError | ValueError):
            error = mistake_at(self._rows, self.i, accepted.x, sample.seen) or error
        reason = error if isinstance(error, RuleError) else error_line(error)
        return f"agent {self.name} failed at sample {sample.k}: {reason}"

    def _answer(self, accepted: Accepted) -> Answer:
        began, sample, x = time.perf_counter(), accepted.sample, accepted.x
        if sample.commands is not None:
            self.apply_commands(sample.commands)
        decided = self._unreported + self._decide_fates(accepted)
        fates, self._unreported = decided[: self.most_fates], decided[self.most_fates :]
        received = self.inbox.received
        watch, delivered = self._watch, self.inbox.delivered
        convictions = watch(sample.t, x, sample.seen, delivered) if watch else ()
        result = self.decide(x, sample.seen, sample.t, received)
        u, t_apply = tuple(result.decision.u.tolist()), sample.t + self._latency
        claimed = u if result.claimed is None else tuple(result.claimed.tolist())
        state = tuple(x[self.swarm.safe_set.parts[self.i]].tolist()) if self._peers else ()
        truth = AnnouncedInput(t_apply, claimed, state)
        return Answer(
            Actuation(k=sample.k, t_apply=t_apply, u=u),
            self._broadcasts(sample, truth, result.reference),
            Telemetry(
                k=sample.k,
                report=result.report(time.perf_counter() - began),
                ages=tuple([(l, sample.t - received[l].t_apply) for l in result.used]),
                fates=fates,
                rejected=self.rejected,
                received=self._clock.reported(received),
                convictions=(*convictions, *result.convictions),
                notes=tuple(result.notes.items()),
            ),
            waits=self._clock.waits,
        )

    def decide(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Call the controller with the stacked state x, shape (n̄,), sampled at t [s]."""
        return self._controller(x, seen, t, received)

    def _broadcasts(
        self, sample: Sample, truth: AnnouncedInput, reference: Array | None
    ) -> dict[int, Broadcast]:
        if not sample.hearers and not self._lies.declared:
            return {}
        relays = self._newest_heard() if truth.x else ()

        def broadcast(claim: AnnouncedInput) -> Broadcast:
            z = claim.x
            if reference is not None:  # a false state has a reference that fits it
                pairs = zip(reference.tolist(), claim.x, truth.x, strict=True)
                z = tuple([r + (said - true) for r, said, true in pairs])
            k, t = sample.k, sample.t if truth.x else 0.0
            return Broadcast(
                k=k, t_apply=claim.t_apply, u=claim.u, t=t, x=claim.x, z=z, relays=relays
            )

        if not self._lies.declared:
            return dict.fromkeys(sample.hearers, broadcast(truth))
        past, names = self._past, self.swarm.names
        claims = {
            l: self._lies.claim(
                names[l],
                sample.k,
                truth,
                lambda ago: past[-ago] if ago <= len(past) else None,
                sample.t,
            )
            for l in sample.hearers
        }
        past.append(truth)
        return {l: broadcast(claim) for l, (claim, _) in claims.items()}

    def _newest_heard(self) -> tuple[Statement, ...]:
        """Return what it heard of its peers last, the newest first, as far as it relays."""
        newest = sorted(self.inbox.received.items(), key=lambda item: (-item[1].t, item[0]))
        return tuple([_relayed(l, s) for l, s in newest if l in self._peers][: self._relays])

    def _decide_fates(self, accepted: Accepted) -> tuple[DeliveryReport, ...]:
        sample, x = accepted.sample, accepted.x
        distances = accepted.distances
        fates = self.inbox.advance(
            self._clock.counted(self.inbox, accepted.existing),
            sample.t,
            lambda j: distances[j] if distances else self.swarm.distance(x, self.i, j),
        )
        for sender, message in self.inbox.corrupt:
            assert isinstance(message, Broadcast)
            key = self._keys.broadcast(self.swarm.names[sender], self.name)
            try:
                self._sealer.open_damaged(key, message, message.k)
            except Malformed:
                self.rejected += 1
        return fates

    def _link(self, sender: int) -> Link:
        swarm, receiver = self.swarm, self.name
        model = swarm.links.model(swarm.names[sender], receiver)
        return Link(swarm.seeds, swarm.names[sender], receiver, model)

    def apply_commands(self, commands: ActiveCommands) -> None:
        """Apply the commands in force from this sample on."""
        if commands == self._commands:
            return
        turned = commands.adversary and not (self._commands and self._commands.adversary)
        self._commands = commands
        self.inbox.override_links(commands.loss, commands.delay)
        if turned:
            honest, attack = self._controller, self._as_adversary()
            self._controller = HijackedController(honest, attack) if commands.hidden else attack


def control_steps(
    rows: SafetyRows, name: str, membership: Membership = _AT_HOME
) -> list[ControlStep]:
    """Make the steps of one process: an agent's own, or the controller's for all normal agents."""
    if name != CONTROLLER:
        return [ControlStep(rows, rows.swarm.names.index(name), membership=membership)]
    part: Callable[[int], FirstController] = part_of_agent("safety.control")(rows).part
    return [ControlStep(rows, i, part(i), membership) for i in rows.swarm.normal]


def _relayed(sender: int, of: SentInput) -> Statement:
    return Statement(sender=sender, k=of.k, t_apply=of.t_apply, u=of.u, t=of.t, x=of.x, z=of.z)


def _most_fates(swarm: Swarm) -> int:
    """Return how many fates fit into a report of MAX_BYTES; after a pause there may be more."""
    u = _HEAD + _FLOAT * max(len(member.dynamics.inputs) for member in swarm.members)
    x = _HEAD + _FLOAT * max(b.states for b in swarm.broadcasters.values())
    age, received = _HEAD + _INT + _FLOAT, _HEAD + _INT + _FLOAT + u
    conviction = _HEAD + _INT + 3 * _FLOAT
    per_agent = age + received + conviction
    other_fields = 200 + LONGEST_FAILURE + u + len(swarm.members) * per_agent
    other_fields += _INT * len(swarm.safe_set.labels)
    faults = _HEAD + _INT * len(swarm.links.declared)
    fate = _HEAD + _INT + _INT + _FLOAT + faults + _HEAD + _FLOAT + u + x
    return max((MAX_BYTES - other_fields) // fate, 1)
