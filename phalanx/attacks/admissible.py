"""Admissible starts: a start next to another agent is no attack."""

from collections.abc import Iterable

import numpy as np

from phalanx.guarantee.start import longest_certificate
from phalanx.scenario.attack import Attack
from phalanx.swarm.swarm import Swarm


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
        for_tau = longest_certificate(swarm, i, x) / swarm.horizon(i)
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
        (swarm.distance(x, i, j), f"{swarm.names[i]} and {swarm.names[j]}")
        for i in swarm.normal
        for j in adversaries
    )
    return min(each, default=(np.inf, ""))
