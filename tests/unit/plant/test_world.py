"""The integration of the true dynamics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_plant.world.disturbance import RandomDisturbance
from phalanx_plant.world.evaluation import Evaluation
from phalanx_plant.world.world import DisturbanceKnot, World
from scipy.integrate import solve_ivp

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from tests.unit.swarms import rows_of_scenario

U = np.array([[3.0, 1.9], [-2.0, 1.0], [4.0, -2.0], [1.0, 0.5], [2.0, -1.0]])


def world(rows: SafetyRows, inputs: np.ndarray = U) -> World:
    world = World(rows)
    for i, u in enumerate(inputs):
        world.apply(i, u)
    return world


def truly(swarm: Swarm, t: float, u: np.ndarray = U) -> np.ndarray:
    """The unicycles under inputs u by an adaptive solver of order 8, knot by knot."""
    sources = [
        RandomDisturbance(0, name, swarm.groups[i].disturbance, 3)
        for i, name in enumerate(swarm.names)
    ]

    def field(time: float, x: np.ndarray, lines: list) -> np.ndarray:
        heading = x[2::3]
        rates = np.stack([u[:, 0] * np.cos(heading), u[:, 0] * np.sin(heading), u[:, 1]], axis=1)
        return (rates + [line.at(time) for line in lines]).ravel()

    x, begin = swarm.start(), 0.0
    while begin < t:
        lines = [source.line(begin) for source in sources]
        end = min(t, *(line.end for line in lines))
        exact = solve_ivp(field, (begin, end), x, "DOP853", args=(lines,), rtol=1e-13, atol=1e-13)
        x, begin = exact.y[:, -1], end
    return x


def test_the_world_follows_the_continuous_dynamics():
    rows = rows_of_scenario("unicycles")
    own = world(rows)
    own.advance(1.0)
    assert own.x == pytest.approx(truly(rows.swarm, 1.0), abs=1e-11)


@pytest.mark.slow
def test_the_integration_is_of_fourth_order():
    """Big inputs make the error visible at steps that the scenario file allows.

    Halving the step divides the error by 16; a third-order method would divide it by 8.
    """
    large, errors = U * [400.0, 150.0], []
    for step in (1e-3, 5e-4, 2.5e-4):
        finer = [f"time.integration_step={step}", "agents.0.disturbance.bound=0.0"]
        rows = rows_of_scenario("unicycles", *finer)
        alone = world(rows, large)
        alone.advance(0.128)
        errors.append(np.abs(alone.x - truly(rows.swarm, 0.128, large)).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.15)


@pytest.mark.slow
@given(st.lists(st.floats(0.0, 0.7), max_size=12))
@settings(max_examples=10)
def test_advancing_in_pieces_gives_the_state_of_advancing_at_once(stops):
    whole, pieces = (world(rows_of_scenario("unicycles")) for _ in range(2))
    whole.advance(0.7)
    for stop in [*sorted(stops), 0.7]:
        pieces.advance(stop)
    assert pieces.t == whole.t == 0.7
    assert pieces.x == pytest.approx(whole.x, abs=1e-9)


def test_the_world_starts_at_the_scenarios_start_with_actuators_at_zero():
    truth = World(rows_of_scenario("unicycles"))
    assert (truth.x == rows_of_scenario("unicycles").swarm.start()).all()
    calm = [f"agents.{group}.disturbance.bound=0.0" for group in (0, 1)]
    still = World(rows_of_scenario("unicycles", *calm))
    before = still.x
    still.advance(0.5)
    assert (still.x == before).all()


def test_h_is_evaluated_at_every_step_of_at_most_a_millisecond():
    rows = rows_of_scenario("unicycles")
    truth = world(rows)
    truth.advance(0.45)
    history = truth.take_history()
    assert truth.take_history() == []
    evaluated = list(Evaluation(rows).of([history]))
    steps = np.concatenate([s.times for s in evaluated])
    assert steps[0] == 0.0
    assert steps[-1] == pytest.approx(0.45)
    assert np.diff(steps).max() <= 1e-3 * (1 + 1e-9)
    assert np.diff(steps).min() > 0
    knots = [s.t for s in history if isinstance(s, DisturbanceKnot)]
    assert knots == pytest.approx([0.0, 0.2, 0.4])
    p = truth.x.reshape(5, 3)
    output = p[:, :2] + 0.25 * np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    first = 1.0 - np.sum((output[0] - output[1]) ** 2)
    assert evaluated[-1].h[-1][evaluated[-1].pairs == 0] == pytest.approx(first)
    assert (evaluated[-1].h_tot >= evaluated[-1].h.max(axis=1)).all()
