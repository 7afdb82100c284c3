"""Which pairs are under a certificate, and until when: judged from the truth alone.

At every input that a normal agent applies, its pairs' certificates are computed from the true state
and that input; nothing that an agent says about itself has a part in it. A pair is covered as long
as one of its normal members holds an input with a certificate: Theorem 2 of docs/certificate.md.
"""

import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.certificate import AgentCertificates, Known
from phalanx.guarantee.verdict import Assumption, CertificateSummary
from phalanx.swarm.swarm import Swarm

Array = NDArray[np.float64]


class Coverage:
    """The certificates of one run."""

    def __init__(self, swarm: Swarm) -> None:
        """Compile every pair's certificate, once for pairs that differ in nothing that counts."""
        known: Known = {}
        pairs = swarm.safe_set.pairs
        self._labels = [swarm.safe_set.label(pair) for pair in pairs]
        self._agents = {i: AgentCertificates(swarm, i, known) for i in swarm.normal}
        self._sides = {
            i: np.array([0 if pairs[p].a == i else 1 for p in each.pairs])
            for i, each in self._agents.items()
        }
        self._until = np.full((2, len(pairs)), -np.inf)
        """When the certificate of each side of each pair ends [s], shape (2, p)."""
        self._inputs = {i: len(swarm.members[i].dynamics.inputs) for i in swarm.normal}
        self.assumption = Assumption(
            "certificates", note="at every instant every pair was under a certificate"
        )
        self.summary = CertificateSummary()

    @property
    def ends(self) -> Array:
        """Until when each pair is certified, with the certificates that there are [s], (p,)."""
        ends: Array = self._until.max(axis=0)
        return ends

    def begin(self, x: Array) -> None:
        """Before its first input takes effect every actuator holds zero, from x(0), (n̄,), on."""
        for i, size in self._inputs.items():
            self._issue(i, 0.0, x, np.zeros(size))

    def reached(self, t: float) -> None:
        """Time has gone on to t [s], with the certificates that there are."""
        ends = self.ends
        covered = bool((ends >= t).all())
        self.assumption.check(covered, t)
        if not covered and self.summary.uncovered is None:
            first = int(ends.argmin())
            self.summary.uncovered = self._labels[first]
            self.summary.uncovered_at = max(0.0, float(ends[first]))

    def applied(self, i: int, t: float, x: Array, u: Array) -> float | None:
        """Normal agent i holds u, shape (m_i,), from t [s] and the true state x, (n̄,), on.

        Returns how long all its pairs are certified [s]; None for an adversary.
        """
        if i not in self._agents:
            return None
        shortest = self._issue(i, t, x, u)
        self.summary.count(shortest, self._agents[i].tau)
        return shortest

    def _issue(self, i: int, t: float, x: Array, u: Array) -> float:
        agent, sides = self._agents[i], self._sides[i]
        times = agent(x, u)
        # The certificate before it ends with the input that it was for.
        self._until[sides, agent.pairs] = np.where(times > 0.0, t + times, -np.inf)
        return float(times.min(initial=np.inf))
