"""What a scenario guarantees, before any run: q, S_I, constants, margins, Theorem 4, limits."""

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.feasibility import ProvenRows, largest_gap, rigorous, rows_at_start
from phalanx.guarantee.formula import Formula, Region, formula, worst_pair
from phalanx.guarantee.gaps import gaps_in_the_proof, words_on_alpha
from phalanx.guarantee.start import CertifiedStart, certified_start
from phalanx.guarantee.workspace import boundary, drawn_states, states_inside, workspace
from phalanx.scenario.lies import LieFault
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.row import joint_sum
from phalanx.theory.rows.terms import TermsFunction

Array = NDArray[np.float64]

_SAMPLES = 2000
_BOUNDARY_STATES = 200
_MOST_PAIRS = 500
"""Of more h_tot is not made into one expression, which takes seconds and soon minutes."""


@dataclass(frozen=True)
class TheoremFour:
    """Eq. (asyncminmaxcondition), asked of sampled states on the boundary of S_I.

    With a margin that is computed η counts as 0, so that what is refuted here is refuted for any
    margin.
    """

    states: int
    """How many were asked."""
    worst: float
    """Largest Σ γ_min + Σ γ_max + α + η; above 0 the condition fails there."""

    @property
    def holds(self) -> bool | None:
        """False if refuted, None if not: samples cannot prove it."""
        return False if self.worst > 0 else None


@dataclass(frozen=True)
class CheckReport:
    """The answers, and in words what they mean."""

    relative_degree: int
    """q."""
    worst_at_start: float
    """Largest ψ_0 ... ψ_{q-1} at x(0); above 0 the start is outside S_I."""
    eta_paper: dict[str, float | None]
    """By normal agent: η(Γ + δ^max) in force with margin = "paper"; None if none is given."""
    formula: Formula | None
    """Of h_tot over the workspace; None if the workspace is not known."""
    pair_formula: Formula | None
    """Likewise of the pair that needs most."""
    eta_local: dict[str, float]
    """By normal agent: the largest local margin of its rows at x(0)."""
    rows_at_start: dict[str, bool]
    """By normal agent: whether K_i(x(0)) is non-empty, with nothing received yet."""
    theorem_4: TheoremFour | None
    largest_gap: float | None
    """Longest time between samples for which every proven K_i(x(0)) (half rows for each pair, local
    margin) is non-empty [s]; None if none is."""
    largest_delay: float
    """Longest delay for which what the rows count on is in force [s]; inf for any."""
    gaps: list[str]
    """What the paper's theorem, or the margin's, lacks whatever the run does; empty if nothing."""
    certified: CertifiedStart
    """What the certificates say that a run is judged by."""
    words: list[str] = field(default_factory=list)
    """What all this means, and what to change."""

    @property
    def may_be_guaranteed(self) -> bool:
        """Whether a run can end guaranteed: it begins under certificates. Gaps do not count."""
        return self.certified.holds


def check(scenario: Scenario) -> CheckReport:
    """Everything that can be said about a scenario without running it.

    Raises:
        ScenarioError: the safe set cannot be built, as when relative degrees are mixed.
    """
    swarm = build_swarm(scenario)
    rows, x, box = require_runnable(swarm), swarm.start(), workspace(swarm)
    unknown: list[str] = []
    of_all = of_pair = theorem = None
    proven: dict[int, ProvenRows] = {}
    if len(swarm.safe_set.pairs) > _MOST_PAIRS:
        unknown.append(
            "The constants of the paper's formula and Theorem 4 are unknown: they need h_tot as "
            f"one expression, and {len(swarm.safe_set.pairs)} pairs are more than the "
            f"{_MOST_PAIRS} that this is done for. Ask of fewer agents at the same density."
        )
        box = []
    elif isinstance(box, tuple):
        theorem = _theorem_four(rows, x, *box)
    else:
        missing = ", ".join(box)
        advice = f"for example {box[0]} = [-3.0, 3.0]"
        unknown.append(
            "The constants of the paper's formula and Theorem 4 are unknown: give bounds for "
            f"{missing} in [workspace], {advice}."
        )
    try:
        if isinstance(box, tuple):
            drawn = drawn_states(scenario.seed, "inside", *box, _SAMPLES)
            region = Region(*box, states_inside(rows.invariants(), x, drawn))
            of_all, of_pair = formula(rows, rows.chain, region), worst_pair(rows, region)
        provable = rigorous(swarm)
        proven = {i: ProvenRows(provable, i, x) for i in swarm.normal}
    except ValueError as error:
        unknown.append(f"No margin can be computed: {error}.")
    report = CheckReport(
        relative_degree=rows.relative_degree,
        worst_at_start=float(rows.invariants()(x).max()),
        eta_paper=_given(rows),
        formula=of_all,
        pair_formula=of_pair,
        eta_local={swarm.names[i]: proof.margin(swarm.horizon(i)) for i, proof in proven.items()},
        rows_at_start=rows_at_start(rows),
        theorem_4=theorem,
        largest_gap=largest_gap(list(proven.values())) if proven else None,
        largest_delay=_largest_delay(swarm),
        gaps=gaps_in_the_proof(swarm),
        certified=certified_start(swarm),
    )
    report.words.extend(_words(swarm, report, unknown))
    return report


def _theorem_four(rows: SafetyRows, x: Array, low: Array, high: Array) -> TheoremFour | None:
    """Σ γ_min + Σ γ_max + α + η at states on the boundary of S_I."""
    inside = rows.invariants()
    if (inside(x) > 0).any():
        return None
    evaluate = TermsFunction(rows.chain, margin=_largest_margin(rows))
    worst, asked = -math.inf, 0
    seed = rows.swarm.scenario.seed
    for y in drawn_states(seed, "boundary", low, high, 10 * _SAMPLES):
        if asked == _BOUNDARY_STATES:
            break
        if (inside(y) <= 0).all():
            continue
        total = joint_sum(evaluate(boundary(inside, x, y)), rows.swarm.normal)
        worst, asked = max(worst, total), asked + 1
    return TheoremFour(asked, worst) if asked else None


def _largest_margin(rows: SafetyRows) -> ca.SX:
    """Of any normal agent's row for h_tot; 0 where it is computed."""
    margins = [rows.margin(i) for i in rows.swarm.normal]
    if rows.swarm.scenario.safety.computes_margin:
        return ca.SX(0)
    own = zip(rows.swarm.normal, margins, strict=True)
    return ca.mmax(ca.vertcat(*[margin.of(rows.chain, i) for i, margin in own]))


def _given(rows: SafetyRows) -> dict[str, float | None]:
    margins = {rows.swarm.names[i]: rows.margin(i) for i in rows.swarm.normal}
    computed = rows.swarm.scenario.safety.computes_margin
    return {
        name: None if computed else margin.scale * margin.eta for name, margin in margins.items()
    }


def _largest_delay(swarm: Swarm) -> float:
    return 0.0 if _leans_on_the_newest(swarm) else math.inf


def _leans_on_the_newest(swarm: Swarm) -> bool:
    """Whether rows count on the last received û, whatever has become of it."""
    paper = swarm.scenario.safety.information is Information.PAPER
    return paper and not swarm.joint and len(swarm.normal) > 1


def _believed_liars(swarm: Swarm) -> list[str]:
    """Agents that are declared to lie to those whose rows count on what is said."""
    believing = Information.PAPER, Information.IN_FLIGHT
    if swarm.scenario.safety.information not in believing or swarm.joint:
        return []
    lies = (f for f in swarm.scenario.faults if isinstance(f, LieFault) and not f.silent)
    names = {fault.agent for fault in lies}
    return [name for i, name in enumerate(swarm.names) if name in names and i in swarm.normal]


def _words(swarm: Swarm, report: CheckReport, unknown: list[str]) -> list[str]:
    words = _words_on_certificates(report)
    theorem = _words_on_the_theorem(swarm, report) + unknown
    if not words:
        words.append(
            "A run can end guaranteed: it begins under certificates, and is judged by those of "
            "every input that is applied, whatever it was made from."
        )
    return words + theorem + words_on_alpha(swarm)


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


def _words_on_the_theorem(swarm: Swarm, report: CheckReport) -> list[str]:
    """What the theorem and the rows lack, which certificates do not ask for."""
    safety, words = swarm.scenario.safety, []
    if report.worst_at_start > 0:
        words.append(
            "The start is outside S_I, the states from which the safe set can be kept: ψ is up to "
            f"{report.worst_at_start:.4g}, where 0 is allowed. Let agents start farther apart or "
            "slower, or raise safety.alpha."
        )
    stuck = [name for name, holds in report.rows_at_start.items() if not holds]
    if stuck:
        words.append(
            f"At the start no input satisfies the rows of {', '.join(stuck)} (K_i is empty). Let "
            "agents start farther apart, or lower what makes the margin large: disturbance.bound "
            "and clock.period."
        )
    words += [f"The paper's theorem proves nothing here: {gap}." for gap in report.gaps]
    if report.gaps:
        words.append(
            "For rows that are proven set safety.control = 'distributed', safety.composition = "
            "'pairs', safety.margin = 'integrated' and safety.information = 'split', and leave out "
            "safety.neighbourhood and time.latency."
        )
    if _leans_on_the_newest(swarm):
        words.append(
            "safety.information = 'paper' counts on the last input received of each neighbour. "
            "With any delay or loss, or where two agents sample at one instant, the neighbour may "
            "apply another one, and rows may hold that do not hold jointly. Take 'in-flight' or "
            "'split'."
        )
    if liars := _believed_liars(swarm):
        words.append(
            f"By faults declared here {', '.join(liars)} will say what it does not apply, and "
            f"safety.information = '{safety.information}' counts on what is said: rows may hold "
            "that do not hold jointly. Take 'split', which asks nobody, or 'worst-case', where a "
            "member that does not keep its rows harms nobody's either."
        )
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    if given and report.formula and max(given) < report.formula.eta:
        words.append(
            f"The margin η = {max(given):.4g} is below the {report.formula.eta:.4g} that the "
            "paper's formula asks for over the workspace: it is a choice, not a bound. Take "
            "safety.margin = 'integrated' or 'local' for one that is."
        )
    if report.relative_degree > 1 and safety.margin == "paper":
        words.append(
            "The relative degree q is above 1, and safety.margin = 'paper' leaves out what the "
            "disturbance does to ψ_1 and those after it. Take 'corrected', 'local' or 'integrated'."
        )
    if report.theorem_4 and report.theorem_4.holds is False:
        words.append(
            "Theorem 4 does not apply: at some state on the boundary the best joint effort of the "
            f"normal agents leaves {report.theorem_4.worst:.4g}, where 0 is allowed, so the backup "
            "alone cannot keep the safe set. Give normal agents more authority, or adversaries and "
            "the disturbance less."
        )
    return words
