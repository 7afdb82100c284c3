"""One control step: sample -> wanted input -> row -> QP (or fallback) -> input."""

import time

import numpy as np
from numpy.typing import NDArray

from agent.controllers import Attack, Controller, Moment, controller
from phalanx.scenario.swarm import Swarm
from phalanx.theory.controller import Decision
from phalanx.theory.laws import Law, View, WorstCase
from phalanx.theory.row import Heard
from phalanx.wire.inbox import BroadcastInbox
from phalanx.wire.links import Link
from phalanx.wire.messages import VERSION, Input, Malformed, Orders, Sample

Array = NDArray[np.float64]


class ControlStep:
    """Agent i's controller: everything between a sample and the input that answers it."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Compile agent i's own copy of the theory."""
        scenario, composed = swarm.scenario, swarm.chain.set
        self.swarm = swarm
        self.i = i
        self.name = swarm.names[i]
        self.inbox = BroadcastInbox(_links(swarm, i))
        self.rejected = 0
        self._next = 0
        self._normal = swarm.normal
        self._orders: Orders | None = None
        self._law: Law = swarm.law(i)
        self._clock = swarm.clock(i)
        self._latency = scenario.time.latency
        self._goal = swarm.goal_of(i)
        self._parts = composed.parts
        self._terms = swarm.terms(i)
        self._controller: Controller = controller(swarm, i)

    @property
    def listens_to(self) -> list[str]:
        """Names of the agents whose broadcasts count for this one."""
        return [self.swarm.names[j] for j in self.inbox.senders]

    def accept_sample(self, sample: Sample) -> Sample:
        """Check a sample against what the plant may send next. Raises Malformed."""
        members = len(self.swarm.members)
        if len(sample.x) != 8 * self.swarm.chain.set.x.numel() or len(sample.latest) != members:
            raise Malformed("wrong size")
        if sample.k != self._next:
            raise Malformed("out of order")
        self._next += 1
        return sample

    def accept_broadcast(self, sender: str, message: Input) -> None:
        """Put another agent's broadcast into the inbox. Raises Malformed."""
        j = self.swarm.names.index(sender)
        if len(message.u) != len(self.swarm.members[j].dynamics.inputs):
            raise Malformed("wrong size")
        if not self.inbox.put(j, message):
            raise Malformed("out of order")

    def __call__(self, sample: Sample) -> Input:
        """Answer a sample. The inbox must not be missing a broadcast that the sample counts."""
        began = time.perf_counter()
        self._obey(sample.orders)
        fates = self.inbox.advance(sample.latest, sample.t)
        x = np.frombuffer(sample.x, dtype="<f8")
        decision, wanted, used = self._decide(x, sample.t)
        return Input(
            version=VERSION,
            k=sample.k,
            t=sample.t,
            t_apply=sample.t + self._latency,
            t_next=self._clock.after(sample.k, sample.t),
            u=tuple(decision.u.tolist()),
            origin=decision.origin,
            residual=decision.residual,
            solve_time=time.perf_counter() - began,
            ages=tuple(used.get(j) for j in range(len(self.swarm.members))),
            fates=fates,
            rejected=self.rejected,
            wanted=tuple(wanted.tolist()),
        )

    def _obey(self, orders: Orders | None) -> None:
        if orders is None or orders == self._orders:
            return
        turned = orders.adversary and not (self._orders and self._orders.adversary)
        self._orders = orders
        self.inbox.change_links(orders.loss, orders.delay)
        if turned:
            self._law, self._controller = WorstCase(), Attack(self.swarm, self.i)

    def _decide(self, x: Array, t: float) -> tuple[Decision, Array, dict[int, float]]:
        """The input, what the law wanted, and the age of every û_l that counted for it [s]."""
        terms = self._terms(x)
        goal = self._goal(t, terms.positions[self.i])
        wanted = self._law.input(View(self.i, self._states(x), self._normal, goal, terms))
        heard = {
            l: Heard(np.array(received.message.u), received.message.t_apply)
            for l, received in self.inbox.received().items()
        }
        now = Moment(t + self._latency, x, terms, wanted, heard)
        decision, used = self._controller(now)
        return decision, wanted, {l: t - heard[l].since for l in used}

    def _states(self, x: Array) -> list[Array]:
        return [x[part] for part in self._parts]


def _links(swarm: Swarm, i: int) -> dict[int, Link]:
    """The links on which agent i listens: from the other normal agents, if it is one itself."""
    if swarm.members[i].adversary:
        return {}
    names, scenario = swarm.names, swarm.scenario
    return {
        j: Link(scenario.seed, names[j], names[i], scenario.network.link(names[j], names[i]))
        for j in swarm.normal
        if j != i
    }
