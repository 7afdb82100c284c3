"""Swarms of scenarios and checks of them that many tests look at, each made once for all."""

from functools import cache

from phalanx.guarantee.check import CheckReport, check
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm, build_swarm


@cache
def swarm_of_scenario(name: str, *overrides: str) -> Swarm:
    """A shipped scenario's swarm. Do not change it."""
    return build_swarm(load(name, overrides))


@cache
def checked(name: str, *overrides: str) -> CheckReport:
    """What a check says of a shipped scenario."""
    return check(load(name, overrides))
