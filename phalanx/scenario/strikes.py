"""All strikes on agents that a scenario declares, from all its [[faults]] together."""

from typing import NamedTuple

from phalanx.faults.strikes import Strike
from phalanx.scenario.agent_faults import OfAgents
from phalanx.scenario.model import Scenario
from phalanx.seeded.draws import Draws


class Struck(NamedTuple):
    """One strike, and the fault that it is of."""

    place: int
    """Of the fault in the scenario's list."""
    fault: OfAgents
    strike: Strike


def all_struck(scenario: Scenario) -> tuple[Struck, ...]:
    """Every strike, in the order of the faults."""
    names = [name for name, _, _ in scenario.roster()]
    return tuple(
        Struck(place, fault, strike)
        for place, fault in enumerate(scenario.faults)
        if isinstance(fault, OfAgents)
        for strike in fault.strikes(
            names, scenario.duration, Draws(scenario.seed, "fault", str(place), width=2)
        )
    )
