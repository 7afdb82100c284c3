"""Which pairs are under a certificate, and until when: judged from the truth alone.

At every input that a normal agent applies, its pairs' certificates are computed from the true state
and that input; nothing that an agent says about itself has a part in it. A pair is covered as long
as one of its normal members holds an input with a certificate: Theorem 2 of docs/certificate.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.reachable import ReachableBoxes
from phalanx.guarantee.verdict import Assumption, CertificateSummary
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.function import Reaching

Array = NDArray[np.float64]

_FEW = 24
"""In so small a swarm it takes longer to look who is near than to ask for all."""


class Held(NamedTuple):
    """An input that an actuator holds from now on."""

    i: int
    t: float
    """[s]"""
    x: Array
    """The true stacked state then, shape (n̄,)."""
    u: Array
    """shape (m_i,)"""


class Coverage:
    """The certificates of one run."""

    def __init__(self, swarm: Swarm) -> None:
        """Compile every kind of pair's certificate."""
        self._composed, pairs = swarm.safe_set, swarm.safe_set.pairs
        certificates = SwarmCertificates(swarm)
        function = swarm.scenario.safety.safe_set_function()
        self._boxes = (
            ReachableBoxes(swarm, function)
            if isinstance(function, Reaching) and len(swarm.members) > _FEW
            else None
        )
        self._agents = {i: certificates.of(i) for i in swarm.normal}
        self._others = {
            i: np.where(ends[:, 0] == i, ends[:, 1], ends[:, 0])
            for i, each in self._agents.items()
            for ends in [certificates.ends[list(each.pairs)]]
        }
        self._pairs = {i: np.array(each.pairs) for i, each in self._agents.items()}
        self._sides = {
            i: np.array([0 if pairs[p].a == i else 1 for p in each.pairs])
            for i, each in self._agents.items()
        }
        self._until = np.full((2, len(pairs)), -np.inf)
        """When the certificate of each side of each pair ends [s], shape (2, p)."""
        self.ends = np.full(len(pairs), -np.inf)
        """Until when each pair is certified, with the certificates that there are [s], (p,)."""
        self._inputs = {i: len(swarm.members[i].dynamics.inputs) for i in swarm.normal}
        self.assumption = Assumption(
            "certificates", note="at every instant every pair was under a certificate"
        )
        self.summary = CertificateSummary()

    def begin(self, x: Array) -> None:
        """Before its first input takes effect every actuator holds zero, from x(0), (n̄,), on."""
        held = [Held(i, 0.0, x, np.zeros(size)) for i, size in self._inputs.items()]
        for (i, t, _, _), proven in zip(held, self.proven(held), strict=True):
            if proven is not None:
                self._issue(i, t, proven)

    def proven(self, held: Sequence[Held]) -> list[Array | None]:
        """For how long each of an agent's pairs is proven safe [s]; None for an adversary's input.

        The inputs of one agent or of several, in the order of their times.
        """
        return [self._proven(*each) if each.i in self._agents else None for each in held]

    def reached(self, t: float) -> None:
        """Time has gone on to t [s], with the certificates that there are."""
        first = int(self.ends.argmin())
        covered = bool(self.ends[first] >= t)
        self.assumption.check(covered, t)
        if not covered and self.summary.uncovered is None:
            self.summary.uncovered = self._composed.label(self._composed.pairs[first])
            self.summary.uncovered_at = max(0.0, float(self.ends[first]))

    def applied(self, i: int, t: float, proven: Array) -> float:
        """Normal agent i's input is held from t [s] on.

        Returns how long all its pairs are certified [s].
        """
        shortest = self._issue(i, t, proven)
        self.summary.count(shortest, self._agents[i].tau)
        return shortest

    def _proven(self, i: int, t: float, x: Array, u: Array) -> Array:
        boxes = self._boxes
        near = None if boxes is None else boxes.near(i, self._others[i], t, x)
        return self._agents[i](x, u, near)

    def _issue(self, i: int, t: float, proven: Array) -> float:
        sides, pairs = self._sides[i], self._pairs[i]
        # The certificate before it ends with the input that it was for.
        self._until[sides, pairs] = np.where(proven > 0.0, t + proven, -np.inf)
        self.ends[pairs] = self._until[:, pairs].max(axis=0)
        return float(proven.min(initial=np.inf))
