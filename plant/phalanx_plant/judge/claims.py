"""Compare the inputs that agents broadcast with those that their actuators held, and since when."""

import math
from array import array
from collections import Counter, defaultdict
from typing import NamedTuple

from phalanx.faults.lies import Past
from phalanx.guarantee.verdict import Assumption
from phalanx.network.inbox import Claim, Fate
from phalanx.swarm.swarm import Swarm

_NOTE = "every broadcast stated an input that its sender's actuator held, and since when"
_TOLERANCE = 1e-9
"""Of times [s]."""


class Finding(NamedTuple):
    """The result of checking one broadcast."""

    false: bool = False
    lies: tuple[int, ...] = ()
    """Numbers of the declared lies that made it false."""


_TRUE = Finding()


class _Truth(NamedTuple):
    """An input that an agent sent to its actuator."""

    planned: Claim
    held_from: float
    """When it took effect [s]; inf if it never did."""


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
        self._truth = [_Inputs(len(m.dynamics.inputs)) for m in swarm.members]
        self._early: defaultdict[tuple[int, int], list[tuple[int, Claim, float]]]
        self._early = defaultdict(list)
        """Reports that arrived before the truth, by sender and number: (receiver, claim, t)."""
        self._false: Counter[str] = Counter()
        self._believed = set[tuple[int, int, int]]()
        """False claims: receiver, sender and claimed time in steps of _TOLERANCE."""
        self.betrayals: dict[str, float] = {}
        """By agent, the time from which it first held another input than it announced [s]."""

    def add_truth(self, i: int, k: int, planned: Claim, held_from: float) -> None:
        """Record agent i's input for sample k, and when its actuator applied it [s]; inf: never."""
        truth = _Truth(planned, held_from)
        self._truth[i].put(k, truth)
        if self._early:
            for receiver, claim, t in self._early.pop((i, k), ()):
                self._compare(i, k, truth, receiver, claim, t)

    def check(self, receiver: int, fate: Fate, t: float, believed: bool = True) -> Finding:
        """Check a broadcast on which the receiver reports at t [s]; a lost one claims nothing.

        believed: whether the receiver's word on it counts.
        """
        for fault in fate.faults:
            self.faults[fault] += 1
        if fate.claim is None or not believed:
            return _TRUE
        truth = self._truth[fate.sender].get(fate.k)
        if truth is None:
            # The input reaches its actuator late: the truth is not known yet.
            self._early[fate.sender, fate.k].append((receiver, fate.claim, t))
            return _TRUE
        return self._compare(fate.sender, fate.k, truth, receiver, fate.claim, t)

    def misled(self, receiver: int, sender: int, t_apply: float) -> bool:
        """Return whether a false broadcast to a receiver had an input from t_apply [s] on."""
        place = round(t_apply / _TOLERANCE)
        return any((receiver, sender, place + off) in self._believed for off in (-1, 0, 1))

    def _compare(
        self, i: int, k: int, truth: _Truth, receiver: int, claim: Claim, t: float
    ) -> Finding:
        planned, held_from = truth
        true = claim == Claim(held_from, planned.u)
        self.truthful.check(true, t)
        if true:
            return _TRUE
        name = self._names[i]
        self._false[name] += 1
        self._believed.add((receiver, i, round(claim.t_apply / _TOLERANCE)))
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
        def past(ago: int) -> tuple[float, ...] | None:
            old = self._truth[i].get(k - ago) if ago <= k else None
            return None if old is None else old.planned.u

        return past


class _Inputs:
    """All inputs of one agent by number, stored as doubles: a long run has many."""

    def __init__(self, size: int) -> None:
        self._width, self._rows = 2 + size, array("d")

    def put(self, k: int, truth: _Truth) -> None:
        rows, begin, planned = self._rows, k * self._width, truth.planned
        if (lacking := begin - len(rows)) > 0:  # samples that were not answered
            rows.extend([math.nan] * lacking)
        row = array("d", (truth.held_from, planned.t_apply, *planned.u))
        rows[begin : begin + self._width] = row

    def get(self, k: int) -> _Truth | None:
        row = self._rows[k * self._width : (k + 1) * self._width]
        return (
            None if not row or math.isnan(row[0]) else _Truth(Claim(row[1], tuple(row[2:])), row[0])
        )
