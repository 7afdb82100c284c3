"""Safe-set functions along the world's history."""

import numpy as np
import pytest
from phalanx_plant.world.evaluation import EvaluatedHistory, EvaluatedSteps, Evaluation
from phalanx_plant.world.world import DisturbanceKnot, World

from tests.unit.swarms import rows_of_scenario

LARGE = ("agents.0.count=28", "agents.1.count=4")


def figures(found: EvaluatedHistory) -> np.ndarray:
    """Time, h_tot and the largest ψ of every step, whichever pairs were left out of h."""
    steps = [s for s in found if isinstance(s, EvaluatedSteps)]
    columns = [np.stack([s.times, s.h_tot, *([s.psi] if len(s.psi) else [])]) for s in steps]
    return np.concatenate(columns, axis=1)


@pytest.mark.parametrize("name", ["unicycles", "formation3d", "swarm"])
def test_several_histories_at_once_give_the_values_of_each_alone(name):
    rows = rows_of_scenario(name, *(LARGE if name == "swarm" else ()))
    world, histories = World(rows), []
    for stop in (0.003, 0.01, 0.07, 0.0701, 0.62):
        world.advance(stop)
        histories.append(world.take_history())
    together, alone = Evaluation(rows).of(histories), Evaluation(rows)
    knots = []
    for history, found in zip(histories, together, strict=True):
        (expected,) = alone.of([history])
        assert (figures(found) == figures(expected)).all()
        knots += [s.t for s in found if isinstance(s, DisturbanceKnot)]
    assert len(set(knots)) == len(knots) > 1


def test_no_history_has_no_values():
    rows = rows_of_scenario("unicycles")
    assert Evaluation(rows).of([]) == []
    assert Evaluation(rows).of([[], []]) == [[], []]
