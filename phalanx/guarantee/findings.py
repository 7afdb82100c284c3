"""Findings of a check: rows of its table and sentences with what to change, from the same numbers.

Equations and theorems are numbered as in the paper's source: see docs/theory.md.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from phalanx.faults.lies import LieFault
from phalanx.faults.links import HoldFault, LinkFault, Partition
from phalanx.faults.process import AttackFault, HijackFault
from phalanx.guarantee.check_report import CheckReport, Finding, Requirement
from phalanx.guarantee.proof_gaps import alpha_advice
from phalanx.network.link import DELAY, TRACE
from phalanx.swarm.swarm import Swarm, unit_of_psi

_WHOLE = 1e3
_BEYOND = 1e9
"""Larger numbers are not written out."""
_MOST_NAMES = 8
"""Most names of agents in one sentence."""


class Unknown(NamedTuple):
    """A reason for which constants of the paper's formula, or margins, are not computed."""

    setting: str
    """The setting that is missing."""
    words: str


def findings(
    swarm: Swarm,
    report: CheckReport,
    unknown: Sequence[Unknown],
    efforts: tuple[float, float] | None,
) -> list[Finding]:
    """Return the findings on a report.

    Args:
        swarm: of the scenario.
        report: without findings.
        unknown: what could not be computed.
        efforts: where rows read no roles, the mean ‖u - u_nom‖ at x(0), and with halves of pairs.
    """
    ahead = report.promised
    return [
        Finding(None, [str(ahead), *report.grades.sentences(swarm.safety.committed, ahead.times)]),
        Finding(None, report.impossible.sentences),
        Finding(None, _foreign_world(swarm)),
        Finding(Requirement("relative degree q", str(report.relative_degree), "any", "", True)),
        *_start(swarm, report),
        _certificates(report),
        *_rows(swarm, report),
        *_margins(swarm, report, unknown),
        _boundary(swarm, report, unknown),
        _sampling(report),
        _received_inputs(swarm, report),
        _theorem(swarm, report),
        Finding(None, [str(part) for part in (report.kept_distance, report.radio) if part]),
        Finding(None, [reason.words for reason in unknown]),
        Finding(None, [*alpha_advice(swarm), *_resting(swarm), _roles(report, efforts)]),
    ]


def _foreign_world(swarm: Swarm) -> list[str]:
    """Return a sentence on a world of one's own, which no check knows."""
    if swarm.scenario.world is None:
        return []
    return [
        f"The robots move by {swarm.scenario.world['type']}, not by their declared dynamics. All "
        "of this holds as far as a disturbance within the declared bounds explains their motion, "
        "which the run checks."
    ]


def _start(swarm: Swarm, report: CheckReport) -> Iterator[Finding]:
    """Yield for ψ_0, ..., ψ_{q-1} whether the start is in S_I."""
    equation = "(2)" if report.relative_degree == 1 else "(38)"
    for k, psi in enumerate(report.psi_at_start):
        name, value = f"ψ_{k}" if k else "h", _with_unit(psi, swarm, k)
        words = (
            "The start is outside S_I, the states from which the safe set can be kept: ψ is up to "
            f"{rounded(psi)}, where 0 is allowed. Let agents start farther apart or slower, or "
            "raise safety.alpha."
        )
        row = Requirement(f"largest {name} at the start", value, "at most 0", equation, psi <= 0.0)
        yield Finding(row, [words] if psi == report.worst_at_start > 0.0 else ())


def _certificates(report: CheckReport) -> Finding:
    """Find why no run can end guaranteed, if none can."""
    certified, words = report.certified, []
    if not certified.safe:
        words.append("No guarantee: some pair is unsafe at the start. Let agents start apart.")
    for pair, reason in certified.refused.items():
        words.append(f"No guarantee: {pair} cannot be certified: {reason}.")
    row, failing = _of_agents("agents certified at the start", certified.agents, "")
    if failing and certified.safe:
        words.append(
            f"No guarantee: at the start {failing} has no input with which all its pairs are "
            "proven safe until its next sample may come. Let agents start farther apart, or lower "
            "disturbance.bound, clock.period or time.latency."
        )
    return Finding(row, words)


def _rows(swarm: Swarm, report: CheckReport) -> Iterator[Finding]:
    """Find the agents without an input in K_i; nothing where no agent has rows."""
    safety, solvable = swarm.safety, report.rows_at_start
    equation = "(28)" if safety.centralised else "(30)" if report.relative_degree == 1 else "(44)"
    if not solvable:
        return
    row, failing = _of_agents("agents with an input in K_i", solvable, equation)
    # A given margin does not depend on the disturbance or the clock.
    large = "lower what makes the margin large: disturbance.bound and clock.period"
    words = (
        f"At the start no input satisfies the rows of {failing} (K_i is empty). Let agents start "
        f"farther apart, or {large if safety.computes_margin else 'raise safety.alpha'}."
    )
    yield Finding(row, [words] if failing else ())


def _margins(swarm: Swarm, report: CheckReport, unknown: Sequence[Unknown]) -> Iterator[Finding]:
    """Find whether the margins of rows are bounds."""
    q, safety = report.relative_degree, swarm.safety
    equation = "(24)" if q == 1 else "(42)"
    bound = max(report.eta_local.values(), default=math.nan)
    computed = "margin η, at the start"
    if safety.own_margin:
        by = f"by {safety.margin_name}"
        yield Finding(Requirement(computed, by, "not proven", equation, None))
        return
    etas = [eta for eta in report.eta_paper.values() if eta is not None]
    if not etas:
        value = "computed" if math.isnan(bound) else f"computed, {_margin(bound, swarm, q)}"
        yield Finding(Requirement(computed, value, "any bound", equation, True))
        return
    smallest, name, words = min(etas), "margin η, by the formula", []
    value = _with_unit(smallest, swarm, q)
    formula = report.pair_formula if safety.pairwise else report.formula
    if formula is None:
        row = Requirement(name, value, unknown[-1].setting, equation, None)
    else:
        needed = formula.corrected if safety.counts_disturbance else formula.eta
        least = f"at least {_margin(needed, swarm, q)}"
        row = Requirement(name, value, least, equation, smallest >= needed)
        if not row.holds:
            words.append(
                f"The margin η = {rounded(smallest)} is below the {rounded(needed)} of the paper's "
                "formula over the workspace: it is a choice, not a bound. For a bound take "
                "safety.margin = 'integrated' or 'local' and safety.eta = 0."
            )
    if q > 1 and not safety.counts_disturbance:
        words.append(
            "The relative degree q is above 1, and safety.margin = 'paper' leaves out the effect "
            "of the disturbance on ψ_1 and later ones. Take 'corrected', 'local' or 'integrated'."
        )
    yield Finding(row, words)
    if report.eta_local:
        least = f"at least {_margin(bound, swarm, q)}"
        yield Finding(Requirement("margin η, as a bound", value, least, "", smallest >= bound))


def _boundary(swarm: Swarm, report: CheckReport, unknown: Sequence[Unknown]) -> Finding:
    """Find whether Theorem 3's condition is violated at a state."""
    name, equation, condition = "worst joint condition on ∂S_I", "Th. 3 (33)", report.boundary
    if condition is None:
        missing = next((reason.setting for reason in unknown), "a state on ∂S_I")
        allowed = missing if report.worst_at_start <= 0.0 else "start inside S_I"
        return Finding(Requirement(name, "not computed", allowed, equation, None))
    worst, violated = condition.worst, condition.holds is False
    value = _with_unit(worst, swarm, report.relative_degree)
    words = (
        "Theorem 3 does not apply: at some state on the boundary the best joint effort of the "
        f"normal agents leaves {rounded(worst)}, where 0 is allowed, so the backup alone cannot "
        "keep the safe set. Give normal agents more authority, or adversaries and the disturbance "
        "less."
    )
    row = Requirement(name, value, "at most 0", equation, not violated)
    return Finding(row, [words] if violated else ())


def _sampling(report: CheckReport) -> Finding:
    """Find whether inputs are in force no longer than K_i(x(0)) stays non-empty."""
    horizon, largest = f"{rounded(1e3 * report.horizon)} ms", report.largest_gap
    allowed = "no time is proven" if largest is None else f"at most {rounded(1e3 * largest)} ms"
    holds = largest is not None and report.horizon <= largest
    return Finding(Requirement("an input is in force for", horizon, allowed, "(29)", holds))


def _received_inputs(swarm: Swarm, report: CheckReport) -> Finding:
    """Find why rows should not use received inputs, if they do."""
    model = swarm.safety.information_model
    delays = [
        str(rule) for field, rule in swarm.scenario.network.fields() if field in (DELAY, TRACE)
    ]
    unlimited = math.isinf(report.largest_delay)
    allowed = "any" if unlimited else f"at most {rounded(1e3 * report.largest_delay)} ms"
    holds = unlimited or not delays
    row = Requirement("delay of broadcasts", ", ".join(delays) or "none", allowed, "", holds)
    words = [model.advice] if model.advice and len(swarm.normal) > 1 else []
    if not (swarm.by_radio or model.counts_on_received) and _lossy(swarm):
        silent = ", but where an agent is not heard for safety.silence" if model.shares else ""
        words.append(
            f"Loss and delay of broadcasts change nothing here{silent}: agents see the states of "
            f"others, and use no input that they receive ({model.label}). With agents.radio they "
            "know one another by messages alone."
        )
    if turned := _trusted_attackers(swarm):
        words.append(
            f"Declared faults make adversaries of {', '.join(turned)}, and rows count on what "
            f"normal agents do ({model.label}): each agent's row holds, but not the joint "
            "condition. Take safety.information = 'unknown'."
        )
    if liars := _believed_liars(swarm):
        words.append(
            f"Declared faults make broadcasts of {', '.join(liars)} claim inputs that are not "
            f"applied, and rows use these claims ({model.label}): each agent's row holds, but not "
            "the joint condition. Take 'split' with pairs, which uses no received inputs, or "
            "'unknown', where rows hold even if others violate theirs."
        )
    return Finding(row, words)


def _lossy(swarm: Swarm) -> bool:
    """Return whether the scenario declares anything that delays or loses broadcasts."""
    scenario = swarm.scenario
    rules = any(True for _ in scenario.network.fields()) or bool(scenario.network.links)
    return rules or any(
        isinstance(fault, LinkFault | HoldFault | Partition) for fault in scenario.faults
    )


def _believed_liars(swarm: Swarm) -> list[str]:
    """Return the normal agents with declared lies, if rows use received inputs."""
    if not swarm.safety.information_model.counts_on_received:
        return []
    lies = (f for f in swarm.scenario.faults if isinstance(f, LieFault) and not f.silent)
    names = {fault.agent for fault in lies}
    return [name for i, name in enumerate(swarm.names) if name in names and i in swarm.normal]


def _trusted_attackers(swarm: Swarm) -> list[str]:
    """Return the normal agents that declared faults turn, if rows of others count on them."""
    model, names = swarm.safety.information_model, set[str]()
    for fault in swarm.scenario.faults:
        lies = isinstance(fault, HijackFault) and model.counts_on_received
        if isinstance(fault, AttackFault) and (model.shares or lies):
            names.update(fault.agents or swarm.names)
    return [swarm.names[i] for i in swarm.normal if swarm.names[i] in names]


def _theorem(swarm: Swarm, report: CheckReport) -> Finding:
    """Find the unmet requirements of the paper's theorem, and the settings that meet them."""
    gaps, safety = report.gaps, swarm.safety
    number = 1 if safety.centralised else 5 if report.relative_degree > 1 else 2
    words = [f"The paper's theorem proves nothing here: {gap}." for gap in gaps]
    if gaps and (lacking := safety.lacking_for_proof):
        words.append(f"For proven rows set in [safety]: {', '.join(lacking)}.")
    name, count = "gaps in the theorem's proof", str(len(gaps) or "none")
    return Finding(Requirement(name, count, "none", f"Th. {number}", not gaps), words)


def _resting(swarm: Swarm) -> list[str]:
    """Return a sentence on normal agents that have no goal."""
    names = [swarm.names[i] for i in swarm.normal if not swarm.has_goal(i)]
    if not names:
        return []
    listed = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
    return [f"Without goal, slots or flows: {listed}. A law that tracks keeps them at their start."]


def _roles(report: CheckReport, efforts: tuple[float, float] | None) -> str:
    """Return a sentence on what is taken for granted of roles, or what it costs at x(0) not to."""
    if efforts is None:
        return (
            "Taken for granted: agents know who is an adversary, and no other becomes one. Where "
            "any may be taken over take safety.information = 'unknown'."
        )
    solvable = report.rows_at_start.values()
    effort, split = (rounded(value) for value in efforts)
    return (
        "No agent reads a role: each counts everyone else at worst. At the start "
        f"{sum(solvable)} of {len(solvable)} agents have an input in K_i, and inputs are {effort} "
        f"from nominal ones, on average; with halves of pairs, information = 'split', {split}."
    )


def _of_agents(name: str, holds: Mapping[str, bool], equation: str) -> tuple[Requirement, str]:
    """Return the row of a requirement of each agent, and the names of those that do not meet it."""
    failing = [agent for agent, met in holds.items() if not met]
    names = ", ".join(failing)
    value = f"{len(holds) - len(failing)}{f', not {names}' if failing else ''}"
    return Requirement(name, value, f"all {len(holds)}", equation, not failing), names


def _margin(value: float, swarm: Swarm, q: int) -> str:
    if value < _BEYOND:
        return _with_unit(value, swarm, q)
    return "exceeds the available input" if math.isfinite(value) else "unknown"


def _with_unit(value: float, swarm: Swarm, k: int) -> str:
    return f"{rounded(value)} {unit_of_psi(swarm.scenario, k)}".rstrip()


def rounded(value: float) -> str:
    """Return a number with three significant figures, such as 0.0123, 8.06 or 36 900."""
    if not math.isfinite(value):
        return "unlimited"
    if abs(value) >= _BEYOND:
        return "more than 10⁹"
    number = float(f"{value:.3g}")
    return f"{number:,.0f}".replace(",", " ") if abs(number) >= _WHOLE else f"{number:g}"
