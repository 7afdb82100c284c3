"""Agents' inputs and reports, each checked against the sample that it answers."""

from collections import defaultdict
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from msgspec.structs import replace

from phalanx.messages.keys import Keys
from phalanx.messages.kinds import SAYS, Actuation, Sample, Telemetry
from phalanx.messages.seal import Malformed, Sealer
from phalanx.network.inbox import DeliveryReport
from phalanx.swarm.attack import Attack
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.origin import Origin
from phalanx_plant.world.world import Actuators

_MOST_QUOTED = 500
"""Characters of an agent's own words in the reason of a verdict."""


class Answers:
    """The newest sample of each agent, and its answers until they are taken; no I/O."""

    def __init__(
        self,
        swarm: Swarm,
        keys: Keys,
        sealer: Sealer,
        attacks: Mapping[int, Attack] = MappingProxyType({}),
    ) -> None:
        """attacks: of agents that do not attack by themselves, by index: their actuators do."""
        self._names, self._sealer = swarm.names, sealer
        self.senders: dict[str, tuple[int, type[Actuation | Telemetry]]] = {}
        """By key expression, the agent that sends there, and the kind of its messages."""
        for i, name in enumerate(swarm.names):
            self.senders[keys.actuation(name)] = i, Actuation
            self.senders[keys.telemetry(name)] = i, Telemetry
        self._actuators, self._states = Actuators(swarm), StateCodec(swarm)
        self._agents = len(swarm.names)
        self._sizes = [len(m.dynamics.inputs) for m in swarm.members]
        self._faults = len(swarm.links.declared)
        self._latency = swarm.time.latency
        self._origins = {Origin.ATTACK, *swarm.origins}
        self._samples: dict[int, Sample] = {}
        self._inputs: dict[int, Array] = {}
        self._answered = dict.fromkeys(range(self._agents), -1)
        """By agent, the number of the last sample that it answered."""
        self._telemetry: dict[int, dict[int, Telemetry]] = defaultdict(dict)
        """By agent and sequence number, until it is taken."""
        self._reported = dict.fromkeys(range(self._agents), -1)
        """By agent, the number of the last sample that it reported on."""
        self._attacks = attacks
        self._attacked: dict[tuple[int, int], tuple[Decision, Array]] = {}
        """By agent and sample, what is applied in place of the agent's input, and the wish."""

    def expect(self, i: int, sample: Sample) -> None:
        """Expect agent i's answer to this sample."""
        self._samples[i] = sample
        if i in self._attacks and sample.commands and sample.commands.adversary:
            x = self._states.unpack(sample.x, sample.seen)
            self._attacked[i, sample.k] = self._attacks[i](x, sample.seen, sample.t)

    def expected(self, i: int) -> int:
        """The number of agent i's newest sample; -1 before the first."""
        return self._samples[i].k if i in self._samples else -1

    def complete(self, i: int) -> bool:
        """Return whether agent i has answered its newest sample, and reported on it."""
        return self._answered[i] == self._reported[i] == self.expected(i)

    def take_input(self, i: int) -> Array | None:
        """Remove and return agent i's input for its newest sample, shape (m_i,), if it arrived."""
        return self._inputs.pop(i, None)

    def take_reported(self, i: int) -> Array | None:
        """The same, if its report arrived too."""
        return self.take_input(i) if self.expected(i) in self._telemetry[i] else None

    def take_telemetry(self, i: int, k: int) -> Telemetry | None:
        """Remove and return agent i's report on its sample k, if it arrived."""
        return self._telemetry[i].pop(k, None)

    def require_pending(self, key: str, payload: bytes) -> None:
        """Raise Malformed unless the payload is a pending answer. Called in any thread."""
        self._require_pending(*self._open(key, payload))

    def accept(self, key: str, payload: bytes) -> tuple[str, str] | None:
        """Store a pending answer; if it reports a failure, return the agent and its message.

        Raises Malformed for any other payload.
        """
        i, answer = self._open(key, payload)
        if isinstance(answer, Actuation):
            self.on_actuation(i, answer)
            return None
        self.on_telemetry(i, answer)
        name = self._names[i]
        return (name, _failure(name, answer.failed)) if answer.failed else None

    def _open(self, key: str, payload: bytes) -> tuple[int, Actuation | Telemetry]:
        i, kind = self.senders[key]
        return i, self._sealer.open(key, payload, kind)

    def _require_pending(self, i: int, message: Actuation | Telemetry) -> None:
        """Raise Malformed if agent i's answer came before, or is to no sample of its."""
        reports, newest = isinstance(message, Telemetry), self.expected(i)
        last = (self._reported if reports else self._answered)[i]
        # The plant waits for the actuation only: a report may arrive after the next sample is sent.
        if not (last < message.k <= newest and (reports or message.k == newest)):
            raise Malformed("out of order")

    def on_actuation(self, i: int, message: Actuation) -> None:
        """Store agent i's input. Raises Malformed unless it answers the newest sample within U."""
        if len(message.u) != self._sizes[i]:
            raise Malformed("wrong size")
        self._require_pending(i, message)
        sample = self._samples[i]
        if message.t_apply != sample.t + self._latency:
            raise Malformed("wrong time")
        x, u = self._states.unpack_one(i, sample.x, sample.seen), np.array(message.u)
        if not self._actuators.takes(i, x, u):
            raise Malformed("outside U")
        self._answered[i] = message.k
        taken_over = self._attacked.get((i, message.k))
        self._inputs[i] = taken_over[0].u if taken_over else u

    def _is_possible(self, fate: DeliveryReport) -> bool:
        """Return whether the broadcast exists, and its claim is given unless it was lost."""
        size = None if fate.claim is None else len(fate.claim.u)
        expected = None if fate.delay < 0.0 else self._sizes[fate.sender]
        return 0 <= fate.k <= self.expected(fate.sender) and size == expected

    def on_telemetry(self, i: int, message: Telemetry) -> None:
        """Store agent i's report. Raises Malformed unless it is the first on one of its samples."""
        if len(message.report.u_nom) != self._sizes[i]:
            raise Malformed("wrong size")
        senders = [fate.sender for fate in message.fates]
        senders += [l for l, _ in message.ages] + [l for l, _, _ in message.received]
        senders += [conviction.of for conviction in message.convictions]
        if any(not 0 <= sender < self._agents for sender in senders):
            raise Malformed("unknown sender")
        if message.report.origin not in self._origins:
            raise Malformed("unknown origin")
        if any(not 0 <= n < self._faults for fate in message.fates for n in fate.faults):
            raise Malformed("unknown fault")
        if not all(self._is_possible(fate) for fate in message.fates):
            raise Malformed("unknown broadcast")
        self._require_pending(i, message)
        self._reported[i] = message.k
        if taken_over := self._attacked.pop((i, message.k), None):
            (decision, wish), report = taken_over, message.report
            values = {"u_nom": tuple(wish.tolist()), "residual": decision.residual, "margin": None}
            message = replace(message, report=replace(report, origin=decision.origin, **values))
        self._telemetry[i][message.k] = message


def _failure(name: str, failure: str) -> str:
    """Quote an agent's own words on its failure, which may be anything, with its name."""
    more = " ..." if len(failure) > _MOST_QUOTED else ""
    return f"agent {name} {SAYS}{failure[:_MOST_QUOTED]!r}{more}"
