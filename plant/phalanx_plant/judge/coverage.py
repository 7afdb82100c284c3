"""Certified times of all pairs, computed from the true states and inputs alone.

At every input that a normal agent applies, its pairs' certificates are computed from the true state
and that input; agents' reports are not used. A pair is covered while one of its normal members
holds an input with a certificate: Theorem 2 of docs/certificate.md.
"""

from typing import NamedTuple

import numpy as np

from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.reachable import ReachableBoxes
from phalanx.guarantee.verdict import Assumption, CertificateSummary
from phalanx.recording.columns import Inputs, States
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.safety.function import proven_reach


class Certificates(NamedTuple):
    """Certificates of the pairs of agents that apply inputs, one after the other."""

    inputs: Index
    """The input of each, shape (q,)."""
    sides: Index
    """2 pair + side of the agent that applies it, shape (q,)."""
    seconds: Array
    """For how long the pair is proven safe [s], shape (q,)."""


_Spans = tuple[Index, Array, Index, Index]
"""Pairs, ends of their certificates [s], and for which states each counts: the first, and the one
after the last."""


class Coverage:
    """The certificates of one run."""

    def __init__(self, swarm: Swarm) -> None:
        """Compile the certificate of each kind of pair."""
        self._composed, pairs = swarm.safe_set, swarm.safe_set.pairs
        self._certificates = SwarmCertificates(swarm)
        function = proven_reach(swarm.safety.safe_set_function)
        self._boxes = ReachableBoxes(swarm, function) if function else None
        agents = {i: self._certificates.of(i) for i in swarm.normal}
        self._normal, self._ends = np.array([*agents]), swarm.pairs.every
        # An adversary has no certificates.
        nothing, count = np.zeros(0, dtype=np.intp), len(swarm.members)
        mine = [agents[i].every_side if i in agents else nothing for i in range(count)]
        self._counts, self._mine = np.array([len(sides) for sides in mine]), np.concatenate(mine)
        """Number of each agent's pairs, shape (N,); the numbers of its sides of them, agent by
        agent: 2 pair + side."""
        self._begins = np.cumsum(self._counts) - self._counts
        self._tau = np.array([swarm.horizon(i) if i in agents else np.nan for i in range(count)])
        """τ of each normal agent [s], shape (N,)."""
        self._longest = np.array([agents[i].longest if i in agents else 0.0 for i in range(count)])
        self._until = np.full(2 * len(pairs), -np.inf)
        """End of the certificate of each side of each pair [s], pair by pair, shape (2p,)."""
        self.ends = np.full(len(pairs), -np.inf)
        """Time until which each pair is certified so far [s], shape (p,)."""
        self.least = np.full(len(pairs), np.inf)
        """The least time that was left of each pair's certificate [s], shape (p,); < 0: none."""
        self._excluded = np.zeros(len(pairs), dtype=bool)
        self._adversary: Mask = ~np.isin(np.arange(count), swarm.normal)
        self._widest = max(len(m.dynamics.inputs) for m in swarm.members)
        self.assumption = Assumption(
            "certificates", note="at every instant every pair was under a certificate"
        )
        self.summary = CertificateSummary()

    def begin(self, x: Array) -> None:
        """Certify the zeros that actuators hold from x(0), shape (n̄,), until their first input."""
        i, t = self._normal, np.zeros(len(self._normal))
        zeros = np.zeros((len(i), self._widest))
        issued = self._proven(i, self._counts[i], t, np.tile(x, (len(i), 1)), zeros)
        self._issue(issued, t, np.zeros(len(issued.inputs), dtype=np.intp), 0)

    def proven(self, inputs: Inputs, x: Array) -> Certificates:
        """Compute for how long the pairs of agents that apply inputs are proven safe.

        x: the true stacked states then, shape (r, n̄).
        """
        counts = np.where(inputs.lost, 0, self._counts[inputs.i])
        return self._proven(inputs.i, counts, inputs.t_apply, x, inputs.u)

    def _proven(self, i: Index, counts: Index, t: Array, x: Array, u: Array) -> Certificates:
        """The same of so many pairs of each."""
        inputs = np.arange(len(i)).repeat(counts)
        begins = (self._begins[i] - (np.cumsum(counts) - counts)).repeat(counts)
        sides = self._mine[begins + np.arange(len(inputs))]
        seconds, near = self._longest[i[inputs]], np.full(len(inputs), True)
        if self._boxes is not None and len(inputs):
            others = self._ends[sides >> 1, 1 - (sides & 1)]
            near = self._boxes.near(i[inputs], others, inputs, t, x)
        seconds[near] = self._certificates.proven(sides[near], inputs[near], x, u)
        return Certificates(inputs, sides, seconds)

    def add(self, states: States, inputs: Inputs, issued: Certificates) -> Array:
        """Issue the certificates of applied inputs, and check that all pairs are certified.

        Returns the time that all pairs of each input's agent are certified [s], shape (r,); NaN of
        an adversary, and of a lost input.
        """
        first = np.searchsorted(states.number, inputs.number)
        spans = self._issue(issued, inputs.t_apply, first[issued.inputs], len(states.t))
        self._check(states.t, spans)
        shortest = np.full(len(inputs.i), np.inf)
        np.minimum.at(shortest, issued.inputs, issued.seconds)
        none = inputs.lost | self._adversary[inputs.i]
        self.summary.count(shortest[~none], self._tau[inputs.i[~none]])
        return np.where(none, np.nan, shortest)

    def turned(self, i: int, excluded: Index) -> None:
        """Require no certificate of these pairs any more, as agent i became an adversary."""
        self._adversary[i] = True
        self._excluded[excluded] = True

    def _issue(self, issued: Certificates, t: Array, first: Index, states: int) -> _Spans:
        """Return how long pairs are certified at so many states.

        t: when each input is applied [s], shape (r,). first: the first state after it of each
        certificate, shape (q,).
        """
        # Pair by pair, and in each in the order of inputs.
        order = np.argsort(issued.sides >> 1, kind="stable")
        sides, seconds, first = issued.sides[order], issued.seconds[order], first[order]
        t, pairs, rows = t[issued.inputs[order]], sides >> 1, np.arange(len(order))
        # The previous certificate ends with its input.
        until = np.where(seconds > 0.0, t + seconds, -np.inf)
        newest = [np.maximum.accumulate(np.where(sides & 1 == side, rows, -1)) for side in (0, 1)]
        other = np.where(sides & 1, *newest)
        is_new = other >= np.searchsorted(pairs, pairs)
        ends = np.maximum(until, np.where(is_new, until[other], self._until[sides ^ 1]))
        every, stop = np.arange(len(self.ends)), np.full(len(self.ends) + len(rows), states)
        stop[pairs[::-1]] = first[::-1]  # of several rows the last one written counts
        follows = np.flatnonzero(pairs[1:] == pairs[:-1])
        stop[len(self.ends) + follows] = first[follows + 1]
        spans = (
            np.concatenate([every, pairs]),
            np.concatenate([self.ends, ends]),
            np.concatenate([np.zeros_like(every), first]),
            stop,
        )
        self._until[sides] = until
        self.ends[pairs] = ends
        return spans

    def _check(self, t: Array, spans: _Spans) -> None:
        """Check that all pairs are certified at each state, at t [s], shape (n,)."""
        some = spans[2] < spans[3]
        pairs, first, stop = spans[0][some], spans[2][some], spans[3][some]
        ends = np.where(self._excluded[pairs], np.inf, spans[1][some])
        np.minimum.at(self.least, pairs, ends - t[stop - 1])
        # From the first state after its end on a pair is uncovered, until it has another.
        begins = np.maximum(first, np.searchsorted(t, ends, side="right"))
        edges, late = np.zeros(len(t) + 1, dtype=np.intp), begins < stop
        np.add.at(edges, begins[late], 1)
        np.subtract.at(edges, stop[late], 1)
        uncovered = np.cumsum(edges[:-1]) > 0
        self.assumption.check_each(~uncovered, t)
        if late.any() and self.summary.uncovered is None:
            state = int(uncovered.argmax())
            then = (first <= state) & (state < stop)
            pair = min(zip(ends[then].tolist(), pairs[then].tolist(), strict=True))[1]
            self.summary.uncovered = self._composed.label(self._composed.pairs[pair])
            self.summary.uncovered_at = max(0.0, min(ends[then].tolist()))
