"""Swarms of scenarios, their rows and checks of them, each made once for all tests that look."""

from functools import cache

from phalanx.guarantee.check import check
from phalanx.guarantee.check_report import CheckReport
from phalanx.scenario.load import load
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm


@cache
def swarm_of_scenario(name: str, *overrides: str) -> Swarm:
    """A shipped scenario's swarm."""
    return build_swarm(load(name, overrides))


@cache
def rows_of_scenario(name: str, *overrides: str) -> SafetyRows:
    """Build the rows of a shipped scenario."""
    return build_rows(swarm_of_scenario(name, *overrides))


@cache
def checked(name: str, *overrides: str) -> CheckReport:
    """Check a shipped scenario."""
    return check(load(name, overrides))
