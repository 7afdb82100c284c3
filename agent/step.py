"""One control step: a sample in, the input that answers it out."""

import time

import numpy as np

from phalanx.agent.centralised import Part, Together
from phalanx.agent.distributed import Alone, Mind
from phalanx.network.inbox import BroadcastInbox
from phalanx.network.link import Link
from phalanx.scenario.fields import CONTROLLER
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.information import ReceivedInput
from phalanx.wire.messages import VERSION, Input, Malformed, Orders, Sample


class ControlStep:
    """Agent i's side of the wire: what may come, what it has heard, what it says."""

    def __init__(self, swarm: Swarm, i: int, mind: Mind | None = None) -> None:
        """mind: agent i's own unless said otherwise."""
        self.swarm = swarm
        self.i = i
        self.name = swarm.names[i]
        self.inbox = BroadcastInbox(_links(swarm, i))
        self.rejected = 0
        self._next = 0
        self._orders: Orders | None = None
        self._clock = swarm.clock(i)
        self._latency = swarm.scenario.time.latency
        self._mind: Mind = mind or Alone(swarm, i)

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
        heard = {
            l: ReceivedInput(np.array(newest.u), newest.t_apply)
            for l, newest in self.inbox.received().items()
        }
        decision, u_nom, used = self._mind(x, sample.t, heard)
        ages = {l: sample.t - heard[l].since for l in used}
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
            ages=tuple(ages.get(j) for j in range(len(self.swarm.members))),
            fates=fates,
            rejected=self.rejected,
            u_nom=tuple(u_nom.tolist()),
        )

    def _obey(self, orders: Orders | None) -> None:
        if orders is None or orders == self._orders:
            return
        turned = orders.adversary and not (self._orders and self._orders.adversary)
        self._orders = orders
        self.inbox.change_links(orders.loss, orders.delay)
        if turned:
            self._mind = self._mind.turned()


def control_steps(swarm: Swarm, name: str) -> list[ControlStep]:
    """The steps of one process: an agent's own, or the controller's for every normal agent."""
    if name != CONTROLLER:
        return [ControlStep(swarm, swarm.names.index(name))]
    together = Together(swarm)
    return [ControlStep(swarm, i, Part(together, i)) for i in swarm.normal]


def _links(swarm: Swarm, i: int) -> dict[int, Link]:
    """The links on which agent i listens: to the other normal agents, if it counts on them."""
    if swarm.members[i].adversary or swarm.scenario.safety.control == "centralised":
        return {}
    names, scenario = swarm.names, swarm.scenario
    return {
        j: Link(scenario.seed, names[j], names[i], scenario.network.link(names[j], names[i]))
        for j in swarm.normal
        if j != i
    }
