"""Which pairs can be certified, and who has an input with certificates at the start."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.certificates import AgentCertificates, SwarmCertificates
from phalanx.swarm.swarm import Swarm
from phalanx.theory.models.polytope import constant_polytope


class CertifiedStart(NamedTuple):
    """What certificates can say of a scenario before any run."""

    safe: bool
    """Whether every pair's h <= 0 at x(0)."""
    refused: dict[str, str]
    """Pairs that can never be certified, by label, and why."""
    agents: dict[str, bool]
    """By normal agent: whether some input was found at x(0) with which all its pairs are proven
    safe until its next sample may come."""

    @property
    def holds(self) -> bool:
        """Whether a run can begin under certificates."""
        return self.safe and not self.refused and all(self.agents.values())


def certified_start(swarm: Swarm) -> CertifiedStart:
    """Ask the certificates that a run is judged by, at x(0)."""
    certificates = SwarmCertificates(swarm)
    agents = {i: certificates.of(i) for i in swarm.normal}
    composed, x = swarm.safe_set, swarm.start()
    refused = {}
    for number, pair in enumerate(composed.pairs):
        sides = [agents[l].refused for l in (pair.a, pair.b) if l in agents]
        if all(number in side for side in sides):
            refused[composed.label(pair)] = sides[0][number]
    begun = {swarm.names[i]: _begins(swarm, i, each, x) for i, each in agents.items()}
    h = swarm.pairs.choose(swarm.pairs.among(range(len(swarm.members)))).h(x)
    return CertifiedStart(bool((h <= 0.0).all()), refused, begun)


def _begins(swarm: Swarm, i: int, certificates: AgentCertificates, x: Array) -> bool:
    """Whether zero, or a corner of U_i, is certified: zero alone until a latency is over."""
    clock, latency = swarm.groups[i].clock, swarm.scenario.time.latency
    dynamics = swarm.members[i].dynamics
    zero = np.zeros(len(dynamics.inputs))
    asked = [pair not in certificates.refused for pair in certificates.pairs]
    inputs, needed = [zero], latency
    if not latency:
        state = ca.SX.sym("x", len(dynamics.states))
        known = constant_polytope(*dynamics.input_polytope(state))
        inputs += [] if known is None else list(known.corners)
        needed = clock.period - clock.jitter
    return any(bool((certificates(x, u)[asked] >= needed).all()) for u in inputs)
