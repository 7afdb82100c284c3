"""Why a scenario's margin and rows, as they are written, prove nothing; and which α_q serves."""

from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.integrated import STEEPEST
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.rows.information import Information
from phalanx.theory.safety.class_k import Linear

_SERVES, _WEAK = 0.25, 0.15
"""κ τ of an α_q that serves a proof, and below which it is weak; evidence/paper/frontier.py."""


def gaps_in_the_proof(swarm: Swarm) -> list[str]:
    """What is missing for a proof, in words; empty if nothing is.

    What a run can check, such as the sampling gap and the age of û, is not among these.
    """
    safety = swarm.scenario.safety
    steepest = _steepest(swarm) / _longest(swarm)
    gaps = {
        "the margin η is a given number, not a bound: set safety.margin = 'integrated'": (
            not safety.computes_margin
        ),
        f"α_q is steeper than what is proven for safety.margin = 'integrated': let the last of "
        f"safety.alpha be at most {steepest:.3g}, or clocks be faster": (
            safety.margin == "integrated" and _steepness(swarm) > _steepest(swarm)
        ),
        "safety.margin_scale is below 1, so the margin is less than its bound": (
            safety.margin_scale < 1.0
        ),
        "agents compute their shares of one row for all pairs from different samples: set "
        "safety.composition = 'pairs'": (
            safety.control == "distributed"
            and safety.composition == "lse"
            and safety.information is Information.SPLIT
        ),
        "with safety.neighbourhood, or sensing, each agent's condition changes as others come and "
        "go: leave it out": swarm.limited,
        "one controller needs agents that sample together: one clock.period, no clock.jitter": (
            safety.control == "centralised" and not swarm.synchronous
        ),
        "until time.latency is over no certified input is in force: leave it out": (
            swarm.scenario.time.latency > 0.0
        ),
    }
    return [gap for gap, open_ in gaps.items() if open_]


def words_on_alpha(swarm: Swarm) -> list[str]:
    """Whether α_q is weaker or steeper than what serves a proof, where one is asked for."""
    if not swarm.scenario.safety.computes_margin:
        return []
    steepness = _steepness(swarm)
    if steepness < _WEAK:
        found = (
            "weak: far from every conflict the margin grows with the distance, and α_q has to pay "
            "for it, or K_i is empty"
        )
    elif steepness > STEEPEST[RowPart.HALF]:
        found = "steep: what α_q lets h gain on its limit is spent before the agent samples again"
    else:
        return []
    longest = _longest(swarm)
    return [
        f"The last of safety.alpha, {steepness / longest:.3g}, is {found}. Where an input is in "
        f"force for up to τ = {longest * 1e3:.3g} ms, "
        f"about 0.25/τ = {_SERVES / longest:.3g} serves."
    ]


def _steepness(swarm: Swarm) -> float:
    """κ τ; that of what serves if α_q is not linear."""
    alpha = swarm.scenario.safety.class_k()[-1]
    return alpha.gain * _longest(swarm) if isinstance(alpha, Linear) else _SERVES


def _steepest(swarm: Swarm) -> float:
    """κ τ that is proven with the integrated margin."""
    halves = swarm.joint and len(swarm.normal) > 1
    return STEEPEST[RowPart.HALF if halves else RowPart.WHOLE]


def _longest(swarm: Swarm) -> float:
    """τ of the normal agent that holds its inputs longest [s]."""
    return max(swarm.horizon(i) for i in swarm.normal)
