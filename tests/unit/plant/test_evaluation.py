"""Safe-set functions along the world's history."""

from collections.abc import Iterable

import numpy as np
import pytest
from phalanx_plant.world.evaluation import EvaluatedSteps, Evaluation
from phalanx_plant.world.world import World

from tests.unit.swarms import rows_of_scenario

LARGE = ("agents.0.count=28", "agents.1.count=4")


def figures(steps: Iterable[EvaluatedSteps], number: int = 0) -> np.ndarray:
    """Time, h_tot and the largest ψ of every step of a history, whatever was left out of h."""
    columns = [
        np.stack([s.times, s.h_tot, *([s.psi] if len(s.psi) else [])])[:, s.numbers == number]
        for s in steps
    ]
    return np.concatenate(columns, axis=1)


@pytest.mark.parametrize("name", ["unicycles", "formation3d", "swarm"])
def test_several_histories_at_once_give_the_values_of_each_alone(name):
    rows = rows_of_scenario(name, *(LARGE if name == "swarm" else ()))
    world, histories = World(rows), []
    for stop in (0.003, 0.01, 0.07, 0.0701, 0.62):
        world.advance(stop)
        histories.append(world.take_history())
    together, alone = list(Evaluation(rows).of(histories)), Evaluation(rows)
    for number, history in enumerate(histories):
        values, expected = figures(together, number), figures(alone.of([history]))
        assert values.shape == expected.shape
        assert (values == expected).all()


def test_no_history_has_no_values():
    rows = rows_of_scenario("unicycles")
    assert list(Evaluation(rows).of([])) == []
    assert list(Evaluation(rows).of([[], []])) == []
