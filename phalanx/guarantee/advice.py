"""What a check of a scenario found, in words, and what to change."""

import math

from phalanx.faults.lies import LieFault
from phalanx.guarantee.check_report import CheckReport
from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.integrated import STEEPEST, RowPart
from phalanx.theory.safety.class_k import Linear

_WHOLE = 1e3
_BEYOND = 1e9
"""From here on a number only says that nothing compares with it."""


def in_words(value: float) -> str:
    """A number with three significant figures, such as 0.0123, 8.06 or 36 900."""
    if not math.isfinite(value):
        return "unlimited"
    if abs(value) >= _BEYOND:
        return "more than a thousand million"
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}".replace(",", " ") if abs(rounded) >= _WHOLE else f"{rounded:g}"


_SERVES, _WEAK = 0.25, 0.15
"""κ τ of an α_q that serves a proof, and below which it is weak; evidence/paper/frontier.py."""


def gaps_in_the_proof(swarm: Swarm) -> list[str]:
    """What is missing for a proof, in words; empty if nothing is.

    What a run can check, such as the sampling gap and the age of û, is not among these.
    """
    safety = swarm.safety
    steepest = _steepest(swarm) / _longest(swarm)
    gaps = {
        "the margin η is a given number, not a bound: set safety.margin = 'integrated'": (
            not safety.computes_margin
        ),
        f"α_q is steeper than what is proven for safety.margin = 'integrated': let the last of "
        f"safety.alpha be at most {steepest:.3g}, or clocks be faster": (
            safety.limits_alpha and _steepness(swarm) > _steepest(swarm)
        ),
        "safety.margin_scale is below 1, so the margin is less than its bound": (
            safety.margin_scale < 1.0
        ),
        "agents compute their shares of one row for all pairs from different samples: set "
        "safety.composition = 'pairs'": safety.shares_one_row,
        "with safety.neighbourhood, or sensing, each agent's condition changes as others come and "
        "go: leave it out": swarm.limited,
        "one controller needs agents that sample together: one clock.period, no clock.jitter": (
            safety.centralised and not swarm.synchronous
        ),
        "until time.latency is over no certified input is in force: leave it out": (
            swarm.time.latency > 0.0
        ),
    }
    return [gap for gap, open_ in gaps.items() if open_]


def words_on_alpha(swarm: Swarm) -> list[str]:
    """Whether α_q is weaker or steeper than what serves a proof, where one is asked for."""
    if not swarm.safety.computes_margin:
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
    alpha = swarm.safety.class_k[-1]
    return alpha.gain * _longest(swarm) if isinstance(alpha, Linear) else _SERVES


def _steepest(swarm: Swarm) -> float:
    """κ τ that is proven with the integrated margin."""
    halves = swarm.safety.joint and len(swarm.normal) > 1
    return STEEPEST[RowPart.HALF if halves else RowPart.WHOLE]


def _longest(swarm: Swarm) -> float:
    """τ of the normal agent that holds its inputs longest [s]."""
    return max(swarm.horizon(i) for i in swarm.normal)


def leans_on_the_newest(swarm: Swarm) -> bool:
    """Whether rows count on the last received û, whatever has become of it."""
    return swarm.safety.counts_on_newest and len(swarm.normal) > 1


def _believed_liars(swarm: Swarm) -> list[str]:
    """Agents that are declared to lie to those whose rows count on what is said."""
    if not swarm.safety.counts_on_received:
        return []
    lies = (f for f in swarm.scenario.faults if isinstance(f, LieFault) and not f.silent)
    names = {fault.agent for fault in lies}
    return [name for i, name in enumerate(swarm.names) if name in names and i in swarm.normal]


def advice(swarm: Swarm, report: CheckReport, unknown: list[str]) -> list[str]:
    """What a check found, what it lacks, and which setting supplies it; unknown: in words."""
    words = _words_on_certificates(report)
    if not words:
        words.append(
            "A run can end guaranteed: it begins under certificates, and is judged by those of "
            "every input that is applied, whatever it was made from."
        )
    return [
        *words,
        *_words_on_the_start(report),
        *_words_on_the_theorem(swarm, report),
        *_words_on_what_is_received(swarm),
        *_words_on_the_margin(swarm, report),
        *unknown,
        *words_on_alpha(swarm),
    ]


def _words_on_certificates(report: CheckReport) -> list[str]:
    """What keeps every run from a guarantee."""
    certified, words = report.certified, []
    if not certified.safe:
        words.append("No guarantee: some pair is unsafe at the start. Let agents start apart.")
    for pair, reason in certified.refused.items():
        words.append(f"No guarantee: {pair} cannot be certified: {reason}.")
    begin = [name for name, holds in certified.agents.items() if not holds]
    if begin and certified.safe:
        words.append(
            f"No guarantee: at the start {', '.join(begin)} has no input with which all its pairs "
            "are proven safe until its next sample. Let agents start farther apart, or lower "
            "disturbance.bound, clock.period or time.latency."
        )
    return words


def _words_on_the_start(report: CheckReport) -> list[str]:
    """What the rows lack at the start, which certificates do not ask for."""
    words = []
    if report.worst_at_start > 0:
        words.append(
            "The start is outside S_I, the states from which the safe set can be kept: ψ is up to "
            f"{in_words(report.worst_at_start)}, where 0 is allowed. Let agents start farther "
            "apart or slower, or raise safety.alpha."
        )
    if stuck := [name for name, holds in report.rows_at_start.items() if not holds]:
        # A margin that is given stays what it is.
        computed = any(eta is None for eta in report.eta_paper.values())
        large = "lower what makes the margin large: disturbance.bound and clock.period"
        words.append(
            f"At the start no input satisfies the rows of {', '.join(stuck)} (K_i is empty). Let "
            f"agents start farther apart, or {large if computed else 'raise safety.alpha'}."
        )
    return words


def _words_on_the_theorem(swarm: Swarm, report: CheckReport) -> list[str]:
    """What the theorem lacks, and which settings supply it."""
    words = [f"The paper's theorem proves nothing here: {gap}." for gap in report.gaps]
    safety = swarm.safety
    if report.gaps:
        wanted = {
            "control": "distributed",
            "composition": "pairs",
            "margin": "integrated",
            "information": "split",
        }
        lacking = [f"{k} = '{v}'" for k, v in wanted.items() if getattr(safety, k) != v]
        lacking += [] if safety.computes_margin else ["eta = 0"]
        if lacking:
            words.append(f"For rows that are proven set, of safety, {', '.join(lacking)}.")
    return words


def _words_on_what_is_received(swarm: Swarm) -> list[str]:
    """Where rows count on what others said, and should not."""
    words = []
    if leans_on_the_newest(swarm):
        words.append(
            "safety.information = 'paper' counts on the last received input of each neighbour. "
            "With any delay or loss, or where two agents sample at one instant, the neighbour may "
            "apply another one, and rows may hold that do not hold jointly. Take 'in-flight' or "
            "'split'."
        )
    if liars := _believed_liars(swarm):
        words.append(
            f"By faults declared here {', '.join(liars)} will say what it does not apply, and "
            f"safety.information = '{swarm.safety.information}' counts on what is said: "
            "rows may hold that do not hold jointly. Take 'split', which asks nobody, or "
            "'worst-case', where a member that does not keep its rows harms nobody's either."
        )
    return words


def _words_on_the_margin(swarm: Swarm, report: CheckReport) -> list[str]:
    """Where the margin is less than a bound, and where no margin would do."""
    words = []
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    if given and report.formula and max(given) < report.formula.eta:
        words.append(
            f"The margin η = {in_words(max(given))} is below the {in_words(report.formula.eta)} "
            "that the paper's formula asks for over the workspace: it is a choice, not a bound. "
            "Take safety.margin = 'integrated' or 'local' and safety.eta = 0 for one that is."
        )
    if report.relative_degree > 1 and not swarm.safety.counts_disturbance:
        words.append(
            "The relative degree q is above 1, and safety.margin = 'paper' leaves out what the "
            "disturbance does to ψ_1 and those after it. Take 'corrected', 'local' or 'integrated'."
        )
    if report.boundary and report.boundary.holds is False:
        words.append(
            "Theorem 3 does not apply: at some state on the boundary the best joint effort of the "
            f"normal agents leaves {in_words(report.boundary.worst)}, where 0 is allowed, so the "
            "backup alone cannot keep the safe set. Give normal agents more authority, or "
            "adversaries and the disturbance less."
        )
    return words
