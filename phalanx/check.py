"""What a scenario guarantees, before any run: q, S_I, constants, margins, Theorem 4, limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.scenario.model import Scenario
from phalanx.scenario.swarm import Swarm, build_swarm
from phalanx.theory.compiled import CompiledFunction
from phalanx.theory.constants import Constant, constants, margin_constants
from phalanx.theory.controller import least_violation
from phalanx.theory.pairs import HALF, PairTerms, PairTermsFunction, pair_rows
from phalanx.theory.polytope import Polytope
from phalanx.theory.row import Information
from phalanx.theory.terms import TermsFunction
from phalanx.workspace import boundary, states_inside, workspace

Array = NDArray[np.float64]

_SAMPLES = 2000
_BOUNDARY_STATES = 200
_SHORTEST, _LONGEST, _BISECTIONS = 1e-6, 10.0, 20
"""The sampling gaps that are looked among [s], and how closely."""


@dataclass(frozen=True)
class TheoremFour:
    """Eq. (asyncminmaxcondition), asked of sampled states on the boundary of S_I.

    With margin = "local" η counts as 0, so that what is refuted here is refuted for any margin.
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
    constants: dict[str, Constant]
    """Of h_tot over the workspace; empty if the workspace is not known."""
    eta_paper: dict[str, float | None]
    """By normal agent: η(Γ + δ^max) in force with margin = "paper"; None if none is given."""
    eta_formula: float | None
    """Eq. (mainetadef), or (etaprimedef) for q > 1, from the constants."""
    eta_corrected: float | None
    """The same with L_φ ψ_{q-1} bounded over the workspace."""
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
    """What is missing for a guarantee whatever the run does; empty if nothing is."""
    words: list[str] = field(default_factory=list)
    """What all this means, and what to change."""

    @property
    def may_be_guaranteed(self) -> bool:
        """Whether a run can end guaranteed: nothing known beforehand speaks against it."""
        return not self.gaps and self.worst_at_start <= 0 and all(self.rows_at_start.values())


def check(scenario: Scenario) -> CheckReport:
    """Everything that can be said about a scenario without running it.

    Raises:
        ScenarioError: the safe set cannot be built, as when relative degrees are mixed.
    """
    swarm = build_swarm(scenario)
    x = swarm.start()
    box = workspace(swarm)
    found: dict[str, Constant] = {}
    formula = corrected = None
    theorem = None
    unknown = [] if isinstance(box, tuple) else box
    if isinstance(box, tuple):
        samples = states_inside(swarm, x, *box, _SAMPLES)
        bounds = [swarm.group(l)[0].disturbance.bound for l in range(len(swarm.members))]
        found = constants(swarm.chain, *box, bounds, samples)
        formula, corrected = _formula(swarm, found)
        theorem = _theorem_four(swarm, x, *box)
    rigorous = _rigorous(swarm)
    proven = {i: _ProvenRows(rigorous, i, x) for i in swarm.normal}
    report = CheckReport(
        relative_degree=swarm.chain.relative_degree,
        worst_at_start=float(swarm.invariants()(x)[0].max()),
        constants=found,
        eta_paper=_given(swarm),
        eta_formula=formula,
        eta_corrected=corrected,
        eta_local={swarm.names[i]: rows.margin(swarm.horizon(i)) for i, rows in proven.items()},
        rows_at_start=rows_at_start(swarm),
        theorem_4=theorem,
        largest_gap=_largest_gap(list(proven.values())),
        largest_delay=_largest_delay(swarm),
        gaps=swarm.gaps_in_the_proof(),
    )
    report.words.extend(_words(swarm, report, unknown))
    return report


def rows_at_start(swarm: Swarm) -> dict[str, bool]:
    """By normal agent: whether K_i(x(0)) is non-empty, with nothing received yet."""
    x = swarm.start()
    return {swarm.names[i]: _feasible(swarm, i, x) for i in swarm.normal}


def _formula(swarm: Swarm, found: dict[str, Constant]) -> tuple[float, float]:
    groups = [group for _, group, _ in swarm.scenario.roster()]
    longest = max(swarm.horizon(i) for i in swarm.normal)
    total = sum(group.disturbance.bound for group in groups)
    given = margin_constants(found)
    sampling, whole = given.eta(longest, 0.0), given.eta(longest, total)
    return (whole if swarm.chain.relative_degree == 1 else sampling), whole


def _theorem_four(swarm: Swarm, x: Array, low: Array, high: Array) -> TheoremFour | None:
    """Σ γ_min + Σ γ_max + α + η at states on the boundary of S_I."""
    rng, inside = np.random.default_rng(1), swarm.invariants()
    if (inside(x)[0] > 0).any():
        return None
    evaluate, eta = TermsFunction(swarm.chain), max(swarm.eta(i) for i in swarm.normal)
    worst, asked = -math.inf, 0
    for y in rng.uniform(low, high, (10 * _SAMPLES, len(low))):
        if asked == _BOUNDARY_STATES or (inside(y)[0] <= 0).all():
            continue
        terms = evaluate(boundary(inside, x, y))
        total = terms.unforced + terms.margin + eta
        for l in range(len(swarm.members)):
            total += float(terms.least[l] if l in swarm.normal else terms.most[l])
        worst, asked = max(worst, total), asked + 1
    return TheoremFour(asked, worst) if asked else None


def _given(swarm: Swarm) -> dict[str, float | None]:
    local = swarm.scenario.safety.margin == "local"
    return {swarm.names[i]: None if local else swarm.eta(i) for i in swarm.normal}


def _rigorous(swarm: Swarm) -> Swarm:
    """The same scenario with half rows for each pair and the local margin."""
    scenario = swarm.scenario
    proven = {
        "composition": "pairs",
        "margin": "local",
        "eta": 0.0,
        "information": Information.SPLIT,
        "neighbourhood": None,
    }
    safety = scenario.safety.model_copy(update=proven)
    return build_swarm(scenario.model_copy(update={"safety": safety}))


def _feasible(swarm: Swarm, i: int, x: Array) -> bool:
    """Whether K_i(x) is non-empty, with nothing received."""
    safety = swarm.scenario.safety
    terms = swarm.terms(i)(x)
    if swarm.pair_chains:
        return _pairs_feasible(swarm, i, swarm.pair_terms(i)(x), terms.polytopes[i])
    total = terms.unforced + safety.margin_scale * (swarm.eta(i) + terms.margin)
    split = safety.information is Information.SPLIT
    for l in range(len(swarm.members)):
        helps = l == i or (split and l in swarm.normal)
        total += float(terms.least[l] if helps else terms.most[l])
    return total <= 0


def _pairs_feasible(swarm: Swarm, i: int, terms: PairTerms, inputs: Polytope) -> bool:
    safety = swarm.scenario.safety
    sharing = list(swarm.normal) if safety.information is Information.SPLIT else []
    scale = safety.margin_scale
    rows = pair_rows(terms, swarm.own_pairs(i), {}, sharing, swarm.eta(i), scale)
    u = least_violation(inputs, rows)
    return bool((rows.a @ u <= rows.bound).all())


class _ProvenRows:
    """One agent's half rows for each pair with the local margin, at x(0), for any sampling gap."""

    def __init__(self, swarm: Swarm, i: int, x: Array) -> None:
        """swarm: as _rigorous has it."""
        self._swarm, self._i, self._x = swarm, i, x
        pairs, gap = swarm.own_pairs(i), ca.SX.sym("gap")
        shares = [HALF if p.shared else None for p in pairs]
        margins = [
            swarm.local_margin(p.chain, p.own, share, gap)
            for p, share in zip(pairs, shares, strict=True)
        ]
        composed = swarm.chain.set
        self._margins = CompiledFunction([composed.x, gap], [ca.vertcat(*margins)])
        zero = [(0.0, 0.0)] * len(pairs)
        self._terms = PairTermsFunction(composed, pairs, zero, None)(x)
        self._inputs = TermsFunction(swarm.chain)(x).polytopes[i]

    def margin(self, gap: float) -> float:
        """The largest margin of any row."""
        return float(self._margins(self._x, gap)[0].max())

    def feasible(self, gap: float) -> bool:
        """Whether K_i(x(0)) is non-empty."""
        margins = self._margins(self._x, gap)[0]
        terms = self._terms._replace(margin=margins, half_margin=margins)
        return _pairs_feasible(self._swarm, self._i, terms, self._inputs)


def _largest_gap(rows: Sequence[_ProvenRows]) -> float | None:
    """By bisection; the margin grows with the gap."""

    def holds(gap: float) -> bool:
        return all(row.feasible(gap) for row in rows)

    low, high = _SHORTEST, _LONGEST
    if not holds(low):
        return None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _largest_delay(swarm: Swarm) -> float:
    if swarm.scenario.safety.information is not Information.PAPER or len(swarm.normal) == 1:
        return math.inf
    return 0.0


def _words(swarm: Swarm, report: CheckReport, unknown: list[str]) -> list[str]:
    safety = swarm.scenario.safety
    words = []
    if report.worst_at_start > 0:
        words.append(
            f"The start is outside S_I: some ψ_k is {report.worst_at_start:.4g} > 0. Start farther "
            "apart or slower, or raise safety.alpha."
        )
    stuck = [name for name, holds in report.rows_at_start.items() if not holds]
    if stuck:
        words.append(
            f"K_i is empty at the start for {', '.join(stuck)}: start farther apart, or lower the "
            "margin's causes, the disturbance bound and the sampling period."
        )
    words += [f"No guarantee: {gap}." for gap in report.gaps]
    if report.gaps:
        words.append(
            "For a proven run set composition = 'pairs', margin = 'local', information = 'split', "
            "no neighbourhood and no latency."
        )
    if safety.information is Information.PAPER and len(swarm.normal) > 1:
        words.append(
            "information = 'paper' counts on the last received û: with any delay, or two updates "
            "at one instant, rows may hold that do not hold jointly. Take 'in-flight' or 'split'."
        )
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    if given and report.eta_formula is not None and max(given) < report.eta_formula:
        words.append(
            f"η = {max(given):.4g} is below the formula's {report.eta_formula:.4g} over the "
            "workspace: it is a choice, not a bound."
        )
    if swarm.chain.relative_degree > 1 and safety.margin == "paper":
        words.append("q > 1 and margin = 'paper': L_φ ψ_k for k >= 1 is not bounded. Correct it.")
    if report.theorem_4 and report.theorem_4.holds is False:
        words.append(
            f"Theorem 4 does not apply: on the boundary the best joint effort leaves "
            f"{report.theorem_4.worst:.4g} > 0, so the backup alone cannot keep S."
        )
    if unknown:
        words.append(
            f"No constants: give bounds for {', '.join(unknown)} in [workspace], for example "
            f"{unknown[0]} = [-3.0, 3.0]."
        )
    return words or ["Nothing speaks against a guarantee; the run checks the rest."]
