"""One control step: a sample in, and out what the actuator, the peers and the plant get of it."""

import time
from typing import NamedTuple

import numpy as np

from phalanx.agent.centralised import CentralisedController, CentralisedPart
from phalanx.agent.controller import Controller
from phalanx.agent.distributed import DistributedController
from phalanx.faults.state import Orders
from phalanx.network.inbox import BroadcastInbox
from phalanx.network.link import Link
from phalanx.scenario.fields import CONTROLLER
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.wire.messages import Actuation, Broadcast, Sample, Telemetry
from phalanx.wire.seal import Malformed


class Answer(NamedTuple):
    """What an agent makes of a sample, for its three receivers."""

    actuation: Actuation
    broadcast: Broadcast
    telemetry: Telemetry


class ControlStep:
    """Agent i beside its controller: what may come, what it has received, what it says."""

    def __init__(self, rows: SafetyRows, i: int, controller: Controller | None = None) -> None:
        """controller: agent i's own unless said otherwise."""
        swarm = rows.swarm
        self.swarm = swarm
        self.i = i
        self.name = swarm.names[i]
        self.inbox = BroadcastInbox(_links(swarm, i))
        self.rejected = 0
        """Payloads dropped so far."""
        self._next: int | None = None
        """The sample that has to come next; None before the first."""
        self._orders: Orders | None = None
        self._latency = swarm.scenario.time.latency
        self._controller: Controller = controller or DistributedController(rows, i)

    @property
    def listens_to(self) -> list[str]:
        """Names of the agents whose broadcasts count for this one."""
        return [self.swarm.names[j] for j in self.inbox.senders]

    def accept_sample(self, sample: Sample) -> Sample:
        """Check a sample against what the plant may send next. Raises Malformed.

        The first one may have any number: who takes over from an agent that died joins in the
        middle of a run, with an empty inbox.
        """
        members = len(self.swarm.members)
        if len(sample.x) != 8 * self.swarm.safe_set.x.numel() or len(sample.latest) != members:
            raise Malformed("wrong size")
        if sample.k < 0 or (self._next is not None and sample.k != self._next):
            raise Malformed("out of order")
        if self._next is None and sample.k > 0:
            self.inbox.join_at(sample.latest)
        self._next = sample.k + 1
        return sample

    def accept_broadcast(self, sender: str, message: Broadcast) -> None:
        """Put another agent's broadcast into the inbox. Raises Malformed."""
        j = self.swarm.names.index(sender)
        if len(message.u) != len(self.swarm.members[j].dynamics.inputs):
            raise Malformed("wrong size")
        if not self.inbox.put(j, message):
            raise Malformed("out of order")

    def __call__(self, sample: Sample) -> Answer:
        """Answer a sample. The inbox must not be missing a broadcast that the sample counts."""
        began = time.perf_counter()
        self._obey(sample.orders)
        fates = self.inbox.advance(sample.latest, sample.t)
        x = np.frombuffer(sample.x, dtype="<f8")
        received = self.inbox.received()
        decision, u_nom, used = self._controller(x, sample.t, received)
        ages = {l: sample.t - received[l].since for l in used}
        u, t_apply = tuple(decision.u.tolist()), sample.t + self._latency
        return Answer(
            Actuation(k=sample.k, t_apply=t_apply, u=u),
            Broadcast(k=sample.k, t_apply=t_apply, u=u),
            Telemetry(
                k=sample.k,
                origin=decision.origin,
                residual=decision.residual,
                u_nom=tuple(u_nom.tolist()),
                solve_time=time.perf_counter() - began,
                ages=tuple(ages.get(j) for j in range(len(self.swarm.members))),
                fates=fates,
                rejected=self.rejected,
            ),
        )

    def _obey(self, orders: Orders | None) -> None:
        if orders is None or orders == self._orders:
            return
        turned = orders.adversary and not (self._orders and self._orders.adversary)
        self._orders = orders
        self.inbox.override_links(orders.loss, orders.delay)
        if turned:
            self._controller = self._controller.turned()


def control_steps(rows: SafetyRows, name: str) -> list[ControlStep]:
    """The steps of one process: an agent's own, or the controller's for every normal agent."""
    if name != CONTROLLER:
        return [ControlStep(rows, rows.swarm.names.index(name))]
    whole = CentralisedController(rows)
    return [ControlStep(rows, i, CentralisedPart(whole, i)) for i in rows.swarm.normal]


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
