"""The table of a check: what each requirement needs and what was found, with the equation.

Equations and theorems are numbered as in the paper's source: see docs/theory.md.
"""

import math
from typing import NamedTuple

from phalanx.guarantee.advice import rounded
from phalanx.guarantee.check_report import CheckReport
from phalanx.network.link import DELAY
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import unit_of_psi

_BEYOND_INPUTS = 1e9
"""Margins from here on are shown in words."""
_MISSING = "set [workspace]"


class Requirement(NamedTuple):
    """A row of the table."""

    name: str
    found: str
    allowed: str
    """The setting that is missing, if nothing was found."""
    equation: str
    """In the paper."""
    holds: bool | None
    """None if unknown."""


def requirements(scenario: Scenario, report: CheckReport) -> list[Requirement]:
    """Return every requirement of a scenario's guarantee, in the order of the paper."""
    return [
        *_start(scenario, report),
        _for_all_agents("agents certified at the start", report.certified.agents, ""),
        *_rows(scenario, report),
        *_margins(scenario, report),
        _boundary(scenario, report),
        _gap(report),
        _delay(scenario, report),
        _theorem(scenario, report),
    ]


def _start(scenario: Scenario, report: CheckReport) -> list[Requirement]:
    names = ["h", *(f"ψ_{k}" for k in range(1, report.relative_degree))]
    return [
        Requirement(
            f"largest {name} at the start",
            _with_unit(psi, unit_of_psi(scenario, k)),
            "at most 0",
            "(2)" if report.relative_degree == 1 else "(38)",
            psi <= 0.0,
        )
        for k, (name, psi) in enumerate(zip(names, report.psi_at_start, strict=True))
    ]


def _rows(scenario: Scenario, report: CheckReport) -> list[Requirement]:
    """None where all agents have a controller of their own, and so no rows."""
    holds = report.rows_at_start
    name = "agents with an input in K_i"
    return [_for_all_agents(name, holds, _row(scenario, report))] if holds else []


def _for_all_agents(name: str, holds: dict[str, bool], equation: str) -> Requirement:
    failed = [agent for agent, each in holds.items() if not each]
    exceptions = f", not {', '.join(failed)}" if failed else ""
    found = f"{len(holds) - len(failed)}{exceptions}"
    return Requirement(name, found, f"all {len(holds)}", equation, not failed)


def _margins(scenario: Scenario, report: CheckReport) -> list[Requirement]:
    unit = unit_of_psi(scenario, report.relative_degree)
    equation = "(24)" if report.relative_degree == 1 else "(42)"
    given = [eta for eta in report.eta_paper.values() if eta is not None]
    if scenario.safety.own_margin:
        by = f"by {scenario.safety.margin_name}"
        return [Requirement("margin η, at the start", by, "not proven", equation, None)]
    if not given:
        largest = max(report.eta_local.values(), default=math.nan)
        at_start = "" if math.isnan(largest) else f", {_margin(largest, unit)}"
        return [
            Requirement(
                "margin η, at the start", f"computed{at_start}", "any bound", equation, True
            )
        ]
    smallest = min(given)
    found = _with_unit(smallest, unit)
    safety = scenario.safety
    formula = report.pair_formula if safety.pairwise else report.formula
    if formula is None:
        rows = [Requirement("margin η, by the formula", found, _MISSING, equation, None)]
    else:
        needed = formula.corrected if safety.counts_disturbance else formula.eta
        least = f"at least {_margin(needed, unit)}"
        rows = [Requirement("margin η, by the formula", found, least, equation, smallest >= needed)]
    if report.eta_local:
        local = max(report.eta_local.values())
        least = f"at least {_margin(local, unit)}"
        rows.append(Requirement("margin η, as a bound", found, least, "", smallest >= local))
    return rows


def _boundary(scenario: Scenario, report: CheckReport) -> Requirement:
    name, equation = "effort left on the boundary", "Th. 3 (33)"
    found = report.boundary
    if found is None:
        missing = _MISSING if report.worst_at_start <= 0.0 else "start inside S_I"
        return Requirement(name, "not computed", missing, equation, None)
    worst = _with_unit(found.worst, unit_of_psi(scenario, report.relative_degree))
    return Requirement(name, worst, "at most 0", equation, found.holds is not False)


def _gap(report: CheckReport) -> Requirement:
    found = f"{rounded(1e3 * report.horizon)} ms"
    if report.largest_gap is None:
        return Requirement("an input is in force for", found, "no time is proven", "(29)", False)
    allowed = f"at most {rounded(1e3 * report.largest_gap)} ms"
    return Requirement(
        "an input is in force for", found, allowed, "(29)", report.horizon <= report.largest_gap
    )


def _delay(scenario: Scenario, report: CheckReport) -> Requirement:
    declared = [str(rule) for field, rule in scenario.network.fields() if field == DELAY]
    found, any_ = ", ".join(declared) or "none", math.isinf(report.largest_delay)
    allowed = "any" if any_ else f"at most {rounded(1e3 * report.largest_delay)} ms"
    return Requirement("delay of broadcasts", found, allowed, "", any_ or not declared)


def _theorem(scenario: Scenario, report: CheckReport) -> Requirement:
    number = 5 if report.relative_degree > 1 else 2
    if scenario.safety.centralised:
        number = 1
    gaps = len(report.gaps)
    return Requirement(
        "gaps in the theorem's proof", str(gaps or "none"), "none", f"Th. {number}", not gaps
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
    return f"{rounded(value)} {unit}".rstrip()
