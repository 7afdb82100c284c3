"""The table of a check: what each requirement needs and what was found, with the equation.

Equations and theorems are numbered as in the paper's source: see docs/theory.md.
"""

import math
from typing import NamedTuple

from phalanx.guarantee.check_report import CheckReport, rounded
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
        Requirement("relative degree q", str(report.relative_degree), "any", "", True),
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
    holds, equation = report.rows_at_start, "(30)" if report.relative_degree == 1 else "(44)"
    if scenario.safety.centralised:
        equation = "(28)"
    return [_for_all_agents("agents with an input in K_i", holds, equation)] if holds else []


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
    bound = max(report.eta_local.values(), default=math.nan)
    if not given:
        found = "computed" if math.isnan(bound) else f"computed, {_margin(bound, unit)}"
        return [Requirement("margin η, at the start", found, "any bound", equation, True)]
    smallest, safety = min(given), scenario.safety
    found = _with_unit(smallest, unit)
    needed = report.eta_needed(safety)
    if needed is None:
        rows = [Requirement("margin η, by the formula", found, _MISSING, equation, None)]
    else:
        least = f"at least {_margin(needed, unit)}"
        rows = [Requirement("margin η, by the formula", found, least, equation, smallest >= needed)]
    if report.eta_local:
        least = f"at least {_margin(bound, unit)}"
        rows.append(Requirement("margin η, as a bound", found, least, "", smallest >= bound))
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
    found, largest = f"{rounded(1e3 * report.horizon)} ms", report.largest_gap
    allowed = "no time is proven" if largest is None else f"at most {rounded(1e3 * largest)} ms"
    holds = largest is not None and report.horizon <= largest
    return Requirement("an input is in force for", found, allowed, "(29)", holds)


def _delay(scenario: Scenario, report: CheckReport) -> Requirement:
    declared = [str(rule) for field, rule in scenario.network.fields() if field == DELAY]
    found, any_ = ", ".join(declared) or "none", math.isinf(report.largest_delay)
    allowed = "any" if any_ else f"at most {rounded(1e3 * report.largest_delay)} ms"
    return Requirement("delay of broadcasts", found, allowed, "", any_ or not declared)


def _theorem(scenario: Scenario, report: CheckReport) -> Requirement:
    number, gaps = 5 if report.relative_degree > 1 else 2, str(len(report.gaps) or "none")
    if scenario.safety.centralised:
        number = 1
    return Requirement(
        "gaps in the theorem's proof", gaps, "none", f"Th. {number}", not report.gaps
    )


def _margin(value: float, unit: str) -> str:
    if value < _BEYOND_INPUTS:
        return _with_unit(value, unit)
    return "more than inputs can pay" if math.isfinite(value) else "unknown"


def _with_unit(value: float, unit: str) -> str:
    return f"{rounded(value)} {unit}".rstrip()
