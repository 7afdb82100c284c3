"""Admissible starts: a start next to another agent is no attack."""

from collections.abc import Iterable

import casadi as ca
import numpy as np

from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.scenario.attack import Attack
from phalanx.swarm.swarm import Swarm
from phalanx.theory.models.polytope import constant_polytope


def shortfall(swarm: Swarm, attack: Attack) -> tuple[float, str]:
    """Return by how much the start of a run is not admissible, and the reason; 0 if it is.

    In τ for a certificate that is too short, in m for a distance.
    """
    x = swarm.start()
    apart, who = nearest(swarm)
    if apart < attack.apart:
        reason = f"{who} start {apart:.3g} m apart, expected {attack.apart:g} m"
        return attack.apart - apart, reason
    for i in swarm.normal:
        for_tau = _certified(swarm, i, x)
        if for_tau < attack.certified:
            reason = (
                f"agent {swarm.names[i]} starts with a certificate of {for_tau:.3g} τ, "
                f"expected {attack.certified:g} τ"
            )
            return attack.certified - for_tau, reason
    return 0.0, ""


def nearest(swarm: Swarm) -> tuple[float, str]:
    """Return the least distance of a normal agent from an adversary at x(0) [m], and their names.

    Infinite without adversaries.
    """
    x = swarm.start()
    adversaries = [j for j, member in enumerate(swarm.members) if member.adversary]
    each: Iterable[tuple[float, str]] = (
        (swarm.apart(x, i, j), f"{swarm.names[i]} and {swarm.names[j]}")
        for i in swarm.normal
        for j in adversaries
    )
    return min(each, default=(np.inf, ""))


def _certified(swarm: Swarm, i: int, x: np.ndarray) -> float:
    """Return the longest certificate of all of agent i's pairs by zero or a corner of U, in τ.

    Pairs for which no certificate exists do not count.
    """
    certificates, dynamics = swarm.once(SwarmCertificates).of(i), swarm.members[i].dynamics
    known = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", len(dynamics.states))))
    inputs = [np.zeros(len(dynamics.inputs)), *([] if known is None else known.corners)]
    longest = max(
        float(certificates(x, u)[certificates.provable].min(initial=certificates.longest))
        for u in inputs
    )
    return longest / certificates.tau
