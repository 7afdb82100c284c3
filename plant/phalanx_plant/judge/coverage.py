"""Certified times of all pairs, computed from the true states and inputs alone.

At every input that a normal agent applies, its pairs' certificates are computed from the true state
and that input; agents' reports are not used. A pair is covered while one of its normal members
holds an input with a certificate: Theorem 2 of docs/certificate.md.
"""

from collections.abc import Sequence

import numpy as np

from phalanx.guarantee.certificates import HeldInput, SwarmCertificates
from phalanx.guarantee.reachable import ReachableBoxes
from phalanx.guarantee.verdict import Assumption, CertificateSummary
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.safety.function import proven_reach
from phalanx_plant.world.events import InputApplied


class Coverage:
    """The certificates of one run."""

    def __init__(self, swarm: Swarm) -> None:
        """Compile the certificate of each kind of pair."""
        self._composed, pairs = swarm.safe_set, swarm.safe_set.pairs
        self._certificates = SwarmCertificates(swarm)
        function = proven_reach(swarm.safety.safe_set_function)
        self._boxes = ReachableBoxes(swarm, function) if function else None
        self._agents = {i: self._certificates.of(i) for i in swarm.normal}
        self._pairs = {i: np.array(agent.pairs) for i, agent in self._agents.items()}
        # The number of an agent's side of each pair, and of the other side.
        sides = {i: 2 * self._pairs[i] + agent.sides for i, agent in self._agents.items()}
        self._sides, self._other_sides = sides, {i: numbers ^ 1 for i, numbers in sides.items()}
        self._until = np.full(2 * len(pairs), -np.inf)
        """End of the certificate of each side of each pair [s], pair by pair, shape (2p,)."""
        self.ends = np.full(len(pairs), -np.inf)
        """Time until which each pair is certified so far [s], shape (p,)."""
        self.least = np.full(len(pairs), np.inf)
        """The least time that was left of each pair's certificate [s], shape (p,); < 0: none."""
        self._excluded = np.zeros(len(pairs), dtype=bool)
        self._turned: set[int] = set()
        self._inputs = {i: len(swarm.members[i].dynamics.inputs) for i in swarm.normal}
        self.assumption = Assumption(
            "certificates", note="at every instant every pair was under a certificate"
        )
        self.summary = CertificateSummary()

    def begin(self, x: Array) -> None:
        """Certify the zeros that actuators hold from x(0), shape (n̄,), until their first input."""
        sizes = self._inputs.items()
        zeros = [InputApplied(i, -1, 0.0, 0.0, np.zeros(size), x) for i, size in sizes]
        for zero, proven in zip(zeros, self.proven(zeros), strict=True):
            self._issue(zero.i, 0.0, proven)

    def proven(self, applied: Sequence[InputApplied]) -> list[Array]:
        """Compute, by input, the time that each of its agent's pairs is proven safe [s].

        The inputs are in the order of their times. An adversary's array is empty.
        """
        held = [
            HeldInput(self._agents[event.i], event.x, event.u, self._near(event))
            for event in applied
            if event.i in self._agents
        ]
        times = iter(self._certificates.proven(held) if held else ())
        return [next(times) if event.i in self._agents else np.zeros(0) for event in applied]

    def reached(self, t: float) -> None:
        """Check that all pairs are certified until t [s]."""
        ends = np.where(self._excluded, np.inf, self.ends) if self._turned else self.ends
        np.minimum(self.least, ends - t, out=self.least)
        first = int(ends.argmin())
        covered = bool(ends[first] >= t)
        self.assumption.check(covered, t)
        if not covered and self.summary.uncovered is None:
            self.summary.uncovered = self._composed.label(self._composed.pairs[first])
            self.summary.uncovered_at = max(0.0, float(self.ends[first]))

    def applied(self, i: int, t: float, proven: Array) -> float | None:
        """Issue the certificates of agent i's input, held from t [s] on.

        Returns the time that all its pairs are certified [s]; None for an adversary.
        """
        if i not in self._agents:
            return None
        shortest = self._issue(i, t, proven)
        if i in self._turned:
            return None
        self.summary.count(shortest, self._agents[i].tau)
        return shortest

    def turned(self, i: int, excluded: Index) -> None:
        """Require no certificate of these pairs any more, as agent i became an adversary."""
        self._turned.add(i)
        self._excluded[excluded] = True

    def _near(self, event: InputApplied) -> Mask | None:
        if self._boxes is None:
            return None
        return self._boxes.near(event.i, self._agents[event.i].others, event.t_apply, event.x)

    def _issue(self, i: int, t: float, proven: Array) -> float:
        sides, other_sides, pairs = self._sides[i], self._other_sides[i], self._pairs[i]
        # The previous certificate ends with its input.
        self._until[sides] = until = np.where(proven > 0.0, t + proven, -np.inf)
        self.ends[pairs] = np.maximum(until, self._until[other_sides])
        return float(np.minimum.reduce(proven, initial=np.inf))
