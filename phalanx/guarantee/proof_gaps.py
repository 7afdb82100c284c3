"""Requirements of the paper's theorem, or of the margin's proof, that a scenario does not meet."""

from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.integrated import STEEPEST
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.safety.class_k import Linear

_RECOMMENDED, _WEAK = 0.25, 0.15
"""κ τ of α_q recommended for a proof, and the value below which it is too weak; see
evidence/paper/frontier.py."""


def proof_gaps(swarm: Swarm) -> list[str]:
    """Return the requirements of a proof that the scenario does not meet; empty if none.

    Those checked in a run, such as the sampling gap and the age of û, are not included.
    """
    safety = swarm.safety
    steepest = _steepest(swarm) / swarm.longest_horizon
    others = [n for n, group in zip(swarm.names, swarm.groups, strict=True) if not group.filtered]
    gaps = {
        f"a controller of their own, not the paper's filter, decides for {', '.join(others)}: "
        "leave out agents.controller, or give a program filter = true": bool(others),
        "the margin η is a given number, not a bound: set safety.margin = 'integrated'": (
            not safety.computes_margin
        ),
        f"nothing proves that the margin {safety.margin_name} is a bound: set safety.margin = "
        "'integrated'": safety.own_margin,
        f"α_q is steeper than what is proven for safety.margin = 'integrated': let the last of "
        f"safety.alpha be at most {steepest:.3g}, or clocks be faster": (
            safety.limits_alpha and _steepness(swarm) > _steepest(swarm)
        ),
        "with safety.neighbourhood, or sensing, each agent's condition changes as others come and "
        "go: leave it out": swarm.limited,
        "by radio agents keep their own parts, not the paper's rows": swarm.by_radio,
        "one controller needs agents that sample together: one clock.period, no clock.jitter": (
            safety.centralised and not swarm.synchronous
        ),
        "until time.latency is over no certified input is in force: leave it out": (
            swarm.time.latency > 0.0
        ),
    }
    return [gap for gap, exists in gaps.items() if exists]


def alpha_advice(swarm: Swarm) -> list[str]:
    """Recommend a gain of α_q if it is too weak or too steep for a computed margin."""
    if not swarm.safety.bounds_margin:
        return []
    steepness = _steepness(swarm)
    if steepness < _WEAK:
        fault = (
            "weak: far from every conflict the margin grows with the distance, and K_i is empty "
            "unless α_q grows faster"
        )
    elif steepness > STEEPEST[RowPart.HALF]:
        fault = "steep: it lets h reach its limit before the agent samples again"
    else:
        return []
    longest = swarm.longest_horizon
    return [
        f"The last of safety.alpha, {steepness / longest:.3g}, is {fault}. Where an input is in "
        f"force for up to τ = {longest * 1e3:.3g} ms, "
        f"take about 0.25/τ = {_RECOMMENDED / longest:.3g}."
    ]


def _steepness(swarm: Swarm) -> float:
    """Return κ τ; the recommended one if α_q is not linear."""
    alpha = swarm.safety.class_k[-1]
    return alpha.gain * swarm.longest_horizon if isinstance(alpha, Linear) else _RECOMMENDED


def _steepest(swarm: Swarm) -> float:
    """Return the largest κ τ that is proven with the integrated margin."""
    return STEEPEST[RowPart.HALF if len(swarm.sharing) > 1 else RowPart.WHOLE]
