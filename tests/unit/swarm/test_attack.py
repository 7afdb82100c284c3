"""The attack of an agent that was taken over."""

import numpy as np
import pytest

from phalanx.swarm.attack import Attack
from tests.unit.swarms import rows_of_scenario


@pytest.mark.parametrize("victim", [1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_hijacked_agent_goes_for_the_one_it_sees_as_fast_as_it_can(victim, side):
    x = np.full(8, np.nan)
    x[:2], x[2 * victim : 2 * victim + 2] = 0.0, (2.0 * side, -1.0 * side)
    rows = rows_of_scenario("faults/hijack")
    decision, wish = Attack(rows, 0)(x, (0, victim), 0.5)
    assert decision.origin == "attack"
    assert decision.u.tolist() == wish.tolist() == [4.0 * side, -4.0 * side]
