"""The table of a check: found and allowed, row by row, with the paper's equations.

Equations and theorems have the numbers that the paper's source gives them: see docs/theory.md.
"""

import math
from typing import NamedTuple

from phalanx.guarantee.advice import in_words
from phalanx.guarantee.check_report import CheckReport
from phalanx.network.link import DELAY
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import unit_of_psi

_BEYOND_INPUTS = 1e9
"""A margin from here on is no number to compare with."""


class Asked(NamedTuple):
    """One question of a check."""

    what: str
    found: str
    allowed: str
    """Or, where nothing was found, the setting that is missing."""
    equation: str
    """In the paper."""
    holds: bool | None
    """None if it is unknown, or there is nothing to hold."""


def asked(scenario: Scenario, report: CheckReport) -> list[Asked]:
    """Every question that a check asks of a scenario, in the order of the paper."""
    return [
        *_start(scenario, report),
        _of_every_agent("agents certified at the start", report.certified.agents, ""),
        _of_every_agent(
            "agents with an input in K_i", report.rows_at_start, _row(scenario, report)
        ),
        *_margins(scenario, report),
        _boundary(scenario, report),
        _gap(report),
        _delay(scenario, report),
        _theorem(scenario, report),
    ]


def _start(scenario: Scenario, report: CheckReport) -> list[Asked]:
    names = ["h", *(f"ψ_{k}" for k in range(1, report.relative_degree))]
    return [
        Asked(
            f"largest {name} at the start",
            _with_unit(psi, unit_of_psi(scenario, k)),
            "at most 0",
            "(2)" if report.relative_degree == 1 else "(38)",
            psi <= 0.0,
        )
        for k, (name, psi) in enumerate(zip(names, report.psi_at_start, strict=True))
    ]


def _of_every_agent(what: str, holds: dict[str, bool], equation: str) -> Asked:
    lacking = [agent for agent, each in holds.items() if not each]
    but = f", not {', '.join(lacking)}" if lacking else ""
    found = f"{len(holds) - len(lacking)}{but}"
    return Asked(what, found, f"all {len(holds)}", equation, not lacking)


def _margins(scenario: Scenario, report: CheckReport) -> list[Asked]:
    unit = unit_of_psi(scenario, report.relative_degree)
    equation = "(24)" if report.relative_degree == 1 else "(42)"
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    if not given:
        largest = max(report.eta_local.values(), default=math.nan)
        at_start = "" if math.isnan(largest) else f", {_margin(largest, unit)}"
        return [Asked("margin η, at the start", f"computed{at_start}", "any bound", equation, True)]
    smallest = min(given)
    found = _with_unit(smallest, unit)
    safety = scenario.safety
    formula = report.pair_formula if safety.pairwise else report.formula
    if formula is None:
        rows = [Asked("margin η, by the formula", found, _MISSING, equation, None)]
    else:
        needed = formula.corrected if safety.counts_disturbance else formula.eta
        least = f"at least {_margin(needed, unit)}"
        rows = [Asked("margin η, by the formula", found, least, equation, smallest >= needed)]
    if report.eta_local:
        local = max(report.eta_local.values())
        least = f"at least {_margin(local, unit)}"
        rows.append(Asked("margin η, as a bound", found, least, "", smallest >= local))
    return rows


_MISSING = "set [workspace]"


def _boundary(scenario: Scenario, report: CheckReport) -> Asked:
    what, equation = "effort left on the boundary", "Th. 3 (33)"
    found = report.boundary
    if found is None:
        missing = _MISSING if report.worst_at_start <= 0.0 else "start inside S_I"
        return Asked(what, "not asked", missing, equation, None)
    worst = _with_unit(found.worst, unit_of_psi(scenario, report.relative_degree))
    return Asked(what, worst, "at most 0", equation, found.holds is not False)


def _gap(report: CheckReport) -> Asked:
    found = f"{in_words(1e3 * report.horizon)} ms"
    if report.largest_gap is None:
        return Asked("an input is in force for", found, "no time is proven", "(29)", False)
    allowed = f"at most {in_words(1e3 * report.largest_gap)} ms"
    return Asked(
        "an input is in force for", found, allowed, "(29)", report.horizon <= report.largest_gap
    )


def _delay(scenario: Scenario, report: CheckReport) -> Asked:
    declared = [str(rule) for field, rule in scenario.network.fields() if field == DELAY]
    found, any_ = ", ".join(declared) or "none", math.isinf(report.largest_delay)
    allowed = "any" if any_ else f"at most {in_words(1e3 * report.largest_delay)} ms"
    return Asked("delay of broadcasts", found, allowed, "", any_ or not declared)


def _theorem(scenario: Scenario, report: CheckReport) -> Asked:
    number = 5 if report.relative_degree > 1 else 2
    if scenario.safety.centralised:
        number = 1
    open_ = len(report.gaps)
    return Asked(
        "gaps in the theorem's proof", str(open_ or "none"), "none", f"Th. {number}", not open_
    )


def _row(scenario: Scenario, report: CheckReport) -> str:
    if scenario.safety.centralised:
        return "(28)"
    return "(30)" if report.relative_degree == 1 else "(44)"


def _margin(value: float, unit: str) -> str:
    if value < _BEYOND_INPUTS:
        return _with_unit(value, unit)
    return "more than inputs can pay" if math.isfinite(value) else "unknown"


def _with_unit(value: float, unit: str) -> str:
    return f"{in_words(value)} {unit}".rstrip()
