"""What is said of the states that the world went through."""

import numpy as np
import pytest
from phalanx_plant.world.truth import IntegrationSteps, Seen, Truth
from phalanx_plant.world.world import DisturbanceKnot, World

from tests.unit.swarms import rows_of_scenario

LARGE = ("agents.0.count=28", "agents.1.count=4")


def figures(seen: Seen) -> np.ndarray:
    """Time, h_tot and the largest ψ of every step, whichever pairs were left out of h."""
    steps = [s for s in seen if isinstance(s, IntegrationSteps)]
    columns = [np.stack([s.times, s.h_tot, *([s.psi] if len(s.psi) else [])]) for s in steps]
    return np.concatenate(columns, axis=1)


@pytest.mark.parametrize("name", ["unicycles", "formation3d", "swarm"])
def test_of_several_ways_at_once_is_said_what_is_said_of_each_alone(name):
    rows = rows_of_scenario(name, *(LARGE if name == "swarm" else ()))
    world, ways = World(rows), []
    for stop in (0.003, 0.01, 0.07, 0.0701, 0.62):
        world.advance(stop)
        ways.append(world.take_way())
    together, alone = Truth(rows).of(ways), Truth(rows)
    knots = []
    for way, seen in zip(ways, together, strict=True):
        (expected,) = alone.of([way])
        assert (figures(seen) == figures(expected)).all()
        knots += [s.t for s in seen if isinstance(s, DisturbanceKnot)]
    assert len(set(knots)) == len(knots) > 1


def test_nothing_is_said_of_no_way():
    rows = rows_of_scenario("unicycles")
    assert Truth(rows).of([]) == []
    assert Truth(rows).of([[], []]) == [[], []]
