"""The report of a check of a scenario, and its sentences: findings, and what to change."""

import math
from dataclasses import dataclass, field
from html import escape

from phalanx.faults.lies import LieFault
from phalanx.faults.process import AttackFault, HijackFault
from phalanx.guarantee.formula import Formula
from phalanx.guarantee.start import CertifiedStart, Promise
from phalanx.scenario.safety import Safety
from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.integrated import STEEPEST, RowPart
from phalanx.theory.safety.class_k import Linear

_WHOLE = 1e3
_BEYOND = 1e9
"""Larger numbers are not written out."""
_RECOMMENDED, _WEAK = 0.25, 0.15
"""κ τ of α_q recommended for a proof, and the value below which it is too weak; see
evidence/paper/frontier.py."""


@dataclass(frozen=True)
class BoundaryCondition:
    """Theorem 3's Eq. (asyncminmaxcondition) at sampled states on the boundary of S_I.

    A margin computed in the run counts as 0, so that a violation holds for any margin.
    """

    states: int
    """Number of states."""
    worst: float
    """Largest Σ γ_min + Σ γ_max + α + η; above 0 the condition fails there."""

    @property
    def holds(self) -> bool | None:
        """False if violated, else None: samples cannot prove it."""
        return False if self.worst > 0 else None


@dataclass(frozen=True)
class CheckReport:
    """The results of a check."""

    relative_degree: int
    """q."""
    psi_at_start: tuple[float, ...]
    """Largest ψ_0, ..., ψ_{q-1} at x(0); above 0 the start is outside S_I."""
    eta_paper: dict[str, float | None]
    """By normal agent: η(Γ + δ^max) with margin = "paper"; None for other margins."""
    formula: Formula | None
    """η of h_tot over the workspace; None if the workspace is not known."""
    pair_formula: Formula | None
    """The same for the pair with the largest η."""
    eta_local: dict[str, float]
    """By normal agent: the largest local margin of its rows at x(0)."""
    rows_at_start: dict[str, bool]
    """By normal agent: True if K_i(x(0)) is non-empty, with nothing received yet."""
    boundary: BoundaryCondition | None
    """None if not computed: there is no workspace, or the start is outside S_I."""
    horizon: float
    """Longest time for which a normal agent's input is in force, Γ + δ^max and the latency [s]."""
    largest_gap: float | None
    """The horizon up to which every proven K_i(x(0)) (half rows for each pair, local
    margin) is non-empty [s]; None if there is none."""
    largest_delay: float
    """Longest delay of broadcasts for which received inputs in the rows are in force [s]; may be
    inf."""
    gaps: list[str]
    """Requirements of the paper's theorem, or the margin's proof, that no run can meet."""
    certified: CertifiedStart
    """Certificates at the start, on which the verdict rests."""
    promised: Promise
    """The time for which all pairs are safe, proven before a run."""
    words: list[str] = field(default_factory=list)
    """Sentences on the results, and what to change."""

    @property
    def answer(self) -> str:
        """Sentence on the verdict of a run, as far as it is known before."""
        if self.may_be_guaranteed:
            return "a run can end guaranteed: every pair is certified at the start"
        if not self.certified.safe:
            return "a run will end violated: a pair is unsafe at the start"
        return "a run cannot end guaranteed: no certificate covers its start"

    def eta_needed(self, safety: Safety) -> float | None:
        """The η of the paper's formula for the scenario's rows; None if it is not known."""
        formula = self.pair_formula if safety.pairwise else self.formula
        if formula is None:
            return None
        return formula.corrected if safety.counts_disturbance else formula.eta

    def __repr__(self) -> str:
        return "\n".join([self.answer, *(f"- {words}" for words in self.words)])

    def _repr_html_(self) -> str:
        """Return the answer and the sentences for a notebook."""
        words = "".join(f"<li>{escape(each)}</li>" for each in self.words)
        return f"<p><b>{escape(self.answer)}</b></p><ul>{words}</ul>"

    @property
    def worst_at_start(self) -> float:
        """The largest ψ at x(0)."""
        return max(self.psi_at_start)

    @property
    def may_be_guaranteed(self) -> bool:
        """True if a run can end guaranteed: certificates cover its start. Gaps do not matter."""
        return self.certified.holds


def rounded(value: float) -> str:
    """Return a number with three significant figures, such as 0.0123, 8.06 or 36 900."""
    if not math.isfinite(value):
        return "unlimited"
    if abs(value) >= _BEYOND:
        return "more than 10⁹"
    number = float(f"{value:.3g}")
    return f"{number:,.0f}".replace(",", " ") if abs(number) >= _WHOLE else f"{number:g}"


def proof_gaps(swarm: Swarm) -> list[str]:
    """Return the requirements of a proof that the scenario does not meet; empty if none.

    Those checked in a run, such as the sampling gap and the age of û, are not included.
    """
    safety = swarm.safety
    steepest = _steepest(swarm) / _longest(swarm)
    others = [n for n, group in zip(swarm.names, swarm.groups, strict=True) if group.controller]
    gaps = {
        f"a controller of their own, not the paper's filter, decides for {', '.join(others)}: "
        "leave out agents.controller": bool(others),
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
        found = (
            "weak: far from every conflict the margin grows with the distance, and K_i is empty "
            "unless α_q grows faster"
        )
    elif steepness > STEEPEST[RowPart.HALF]:
        found = "steep: it lets h reach its limit before the agent samples again"
    else:
        return []
    longest = _longest(swarm)
    return [
        f"The last of safety.alpha, {steepness / longest:.3g}, is {found}. Where an input is in "
        f"force for up to τ = {longest * 1e3:.3g} ms, "
        f"take about 0.25/τ = {_RECOMMENDED / longest:.3g}."
    ]


def _steepness(swarm: Swarm) -> float:
    """Return κ τ; the recommended one if α_q is not linear."""
    alpha = swarm.safety.class_k[-1]
    return alpha.gain * _longest(swarm) if isinstance(alpha, Linear) else _RECOMMENDED


def _steepest(swarm: Swarm) -> float:
    """Return the largest κ τ that is proven with the integrated margin."""
    return STEEPEST[RowPart.HALF if len(swarm.sharing) > 1 else RowPart.WHOLE]


def _longest(swarm: Swarm) -> float:
    """Return the largest τ of all normal agents [s]."""
    return max(swarm.horizon(i) for i in swarm.normal)


def longest_delay(swarm: Swarm) -> float:
    """Return the delay of broadcasts up to which received û in the rows are in force [s]."""
    return swarm.safety.information_model.longest_delay if len(swarm.normal) > 1 else math.inf


def _believed_liars(swarm: Swarm) -> list[str]:
    """Return the normal agents with declared lies, if rows use received inputs."""
    if not swarm.safety.information_model.counts_on_received:
        return []
    lies = (f for f in swarm.scenario.faults if isinstance(f, LieFault) and not f.silent)
    names = {fault.agent for fault in lies}
    return [name for i, name in enumerate(swarm.names) if name in names and i in swarm.normal]


def _trusted_attackers(swarm: Swarm) -> list[str]:
    """Return the normal agents that declared faults turn, if rows of others count on them."""
    model, found = swarm.safety.information_model, set[str]()
    for fault in swarm.scenario.faults:
        lies = isinstance(fault, HijackFault) and model.counts_on_received
        if isinstance(fault, AttackFault) and (model.shares or lies):
            found.update(fault.agents or swarm.names)
    return [swarm.names[i] for i in swarm.normal if swarm.names[i] in found]


def advice(swarm: Swarm, report: CheckReport, unknown: list[str]) -> list[str]:
    """Return the findings of a check with the settings to change.

    unknown: sentences on what could not be computed.
    """
    return [
        *_certificate_advice(report),
        *_start_advice(report),
        *_theorem_advice(swarm, report),
        *_received_input_advice(swarm),
        *_margin_advice(swarm, report),
        *unknown,
        *alpha_advice(swarm),
    ]


def _certificate_advice(report: CheckReport) -> list[str]:
    """Return the reasons why no run can end guaranteed."""
    certified, words = report.certified, []
    if not certified.safe:
        words.append("No guarantee: some pair is unsafe at the start. Let agents start apart.")
    for pair, reason in certified.refused.items():
        words.append(f"No guarantee: {pair} cannot be certified: {reason}.")
    begin = [name for name, holds in certified.agents.items() if not holds]
    if begin and certified.safe:
        words.append(
            f"No guarantee: at the start {', '.join(begin)} has no input with which all its pairs "
            "are proven safe until its next sample may come. Let agents start farther apart, or "
            "lower disturbance.bound, clock.period or time.latency."
        )
    return words


def _start_advice(report: CheckReport) -> list[str]:
    """Return what rows, unlike certificates, lack at the start."""
    words = []
    if report.worst_at_start > 0:
        words.append(
            "The start is outside S_I, the states from which the safe set can be kept: ψ is up to "
            f"{rounded(report.worst_at_start)}, where 0 is allowed. Let agents start farther "
            "apart or slower, or raise safety.alpha."
        )
    if stuck := [name for name, holds in report.rows_at_start.items() if not holds]:
        # A given margin does not depend on the disturbance or the clock.
        computed = any(eta is None for eta in report.eta_paper.values())
        large = "lower what makes the margin large: disturbance.bound and clock.period"
        words.append(
            f"At the start no input satisfies the rows of {', '.join(stuck)} (K_i is empty). Let "
            f"agents start farther apart, or {large if computed else 'raise safety.alpha'}."
        )
    return words


def _theorem_advice(swarm: Swarm, report: CheckReport) -> list[str]:
    """Return the unmet requirements of the paper's theorem, and the settings that meet them."""
    words = [f"The paper's theorem proves nothing here: {gap}." for gap in report.gaps]
    if report.gaps and (lacking := swarm.safety.lacking_for_proof):
        words.append(f"For proven rows set in [safety]: {', '.join(lacking)}.")
    return words


def _received_input_advice(swarm: Swarm) -> list[str]:
    """Return why rows should not use received inputs, if they do."""
    model, words = swarm.safety.information_model, []
    if model.advice and len(swarm.normal) > 1:
        words.append(model.advice)
    if turned := _trusted_attackers(swarm):
        words.append(
            f"Declared faults make adversaries of {', '.join(turned)}, and safety.information = "
            f"'{swarm.safety.information}' counts on what normal agents do: each agent's row "
            "holds, but not the joint condition. Take 'unknown'."
        )
    if liars := _believed_liars(swarm):
        words.append(
            f"Declared faults make broadcasts of {', '.join(liars)} claim inputs that are not "
            f"applied, and safety.information = '{swarm.safety.information}' uses these claims: "
            "each agent's row holds, but not the joint condition. Take 'split' with pairs, which "
            "uses no received inputs, or 'unknown', where rows hold even if others violate theirs."
        )
    return words


def _margin_advice(swarm: Swarm, report: CheckReport) -> list[str]:
    """Return where the margin is not a bound, and where no margin would suffice."""
    words = []
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    needed = report.eta_needed(swarm.safety)
    if given and needed is not None and min(given) < needed:
        words.append(
            f"The margin η = {rounded(min(given))} is below the {rounded(needed)} of the paper's "
            "formula over the workspace: it is a choice, not a bound. For a bound take "
            "safety.margin = 'integrated' or 'local' and safety.eta = 0."
        )
    if report.relative_degree > 1 and not swarm.safety.counts_disturbance:
        words.append(
            "The relative degree q is above 1, and safety.margin = 'paper' leaves out the effect "
            "of the disturbance on ψ_1 and later ones. Take 'corrected', 'local' or 'integrated'."
        )
    if report.boundary and report.boundary.holds is False:
        words.append(
            "Theorem 3 does not apply: at some state on the boundary the best joint effort of the "
            f"normal agents leaves {rounded(report.boundary.worst)}, where 0 is allowed, so the "
            "backup alone cannot keep the safe set. Give normal agents more authority, or "
            "adversaries and the disturbance less."
        )
    return words
