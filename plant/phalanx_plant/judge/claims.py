"""Compare the inputs that agents broadcast with those that their actuators held, and since when."""

import math
from array import array
from collections import Counter, defaultdict
from typing import NamedTuple

from phalanx.faults.lies import Past
from phalanx.guarantee.verdict import Assumption
from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.swarm.swarm import Swarm

_NOTE = (
    "every broadcast stated an input that its sender's actuator held, and since when; by radio its "
    "state too"
)


class Finding(NamedTuple):
    """The result of checking one broadcast."""

    false: bool = False
    lies: tuple[int, ...] = ()
    """Numbers of the declared lies that made it false."""


_TRUE = Finding()


class Claims:
    """Compares the claims that receivers report with the truth, which the plant knows.

    Senders are not asked. A receiver that reports another claim than it received accuses its
    sender, and this check cannot tell which of the two lied.
    """

    def __init__(self, swarm: Swarm) -> None:
        self.truthful = Assumption("truthful broadcasts", note=_NOTE)
        self.faults: Counter[int] = Counter()
        """Messages and agents on which each declared fault had an effect."""
        self._names, self._latency = swarm.names, swarm.time.latency
        self._lies = [swarm.links.lies(name) for name in swarm.names]
        stated = {b.i: b.states for b in swarm.broadcasters.values()}
        self._planned = [
            _Inputs(len(m.dynamics.inputs), stated.get(i, 0)) for i, m in enumerate(swarm.members)
        ]
        self._late: dict[tuple[int, int], float] = {}
        """By agent and number, when an input took effect that did so late [s]; inf: never."""
        self._early: defaultdict[tuple[int, int], list[tuple[int, AnnouncedInput, float]]]
        self._early = defaultdict(list)
        """Reports that arrived before the truth, by sender and number: (receiver, claim, t)."""
        self._false: Counter[str] = Counter()
        self._misleading = set[tuple[int, int, float]]()
        """False claims: receiver, sender and claimed time to a nanosecond [s]."""
        self.betrayals: dict[str, float] = {}
        """By agent, the time from which it first held another input than it announced [s]."""

    def add_truth(self, i: int, k: int, planned: AnnouncedInput, held_from: float) -> None:
        """Record agent i's input for sample k, and its state if it states that.

        held_from: when its actuator applied the input [s]; inf: never.
        """
        self._planned[i].put(k, planned)
        if held_from != planned.t_apply:
            self._late[i, k] = held_from
        if self._early:
            for receiver, claim, t in self._early.pop((i, k), ()):
                self._compare(i, k, planned, receiver, claim, t)

    def check(
        self, receiver: int, fate: DeliveryReport, t: float, believed: bool = True
    ) -> Finding:
        """Check a broadcast that a receiver reports at t [s], if believed; losses say nothing."""
        for fault in fate.faults:
            self.faults[fault] += 1
        if fate.claim is None or not believed:
            return _TRUE
        planned = self._planned[fate.sender].get(fate.k)
        if planned is None:
            # The input reaches its actuator late: the truth is not known yet.
            self._early[fate.sender, fate.k].append((receiver, fate.claim, t))
            return _TRUE
        return self._compare(fate.sender, fate.k, planned, receiver, fate.claim, t)

    def misled(self, receiver: int, sender: int, t_apply: float) -> bool:
        """Return whether a false broadcast to a receiver had an input from t_apply [s] on."""
        if not self._misleading:
            return False
        times = {round(t_apply + off, 9) for off in (-1e-9, 0.0, 1e-9)}
        return any((receiver, sender, t) in self._misleading for t in times)

    def _compare(
        self,
        i: int,
        k: int,
        planned: AnnouncedInput,
        receiver: int,
        claim: AnnouncedInput,
        t: float,
    ) -> Finding:
        held_from = self._late.get((i, k), planned.t_apply)
        true = claim == AnnouncedInput(held_from, planned.u, planned.x)
        self.truthful.check(true, t)
        if true:
            return _TRUE
        name = self._names[i]
        self._false[name] += 1
        self._misleading.add((receiver, i, round(claim.t_apply, 9)))
        begin = min(claim.t_apply, held_from)
        self.betrayals[name] = min(begin, self.betrayals.get(name, math.inf))
        counts = ", ".join(f"{count} by {name}" for name, count in self._false.items())
        self.truthful.note = f"{_NOTE}; false were {counts}"
        sampled = planned.t_apply - self._latency
        liar, past = self._lies[i], self._before(i, k)
        lies = liar.claim(self._names[receiver], k, planned, past, sampled).lies
        self.faults.update(lies)
        return Finding(True, lies)

    def _before(self, i: int, k: int) -> Past:
        return lambda ago: self._planned[i].get(k - ago) if ago <= k else None


class _Inputs:
    """All inputs of one agent by number, stored as doubles: a long run has many."""

    def __init__(self, inputs: int, states: int) -> None:
        """states: of those that it states by radio."""
        self._inputs, self._width, self._rows = inputs, 1 + inputs + states, array("d")

    def put(self, k: int, claim: AnnouncedInput) -> None:
        rows, begin = self._rows, k * self._width
        if (lacking := begin - len(rows)) > 0:  # inputs that were lost
            rows.extend([math.nan] * lacking)
        rows[begin : begin + self._width] = array("d", (claim.t_apply, *claim.u, *claim.x))

    def get(self, k: int) -> AnnouncedInput | None:
        row = self._rows[k * self._width : (k + 1) * self._width]
        if not row or math.isnan(row[0]):
            return None
        u, x = row[1 : 1 + self._inputs], row[1 + self._inputs :]
        return AnnouncedInput(row[0], tuple(u), tuple(x))
