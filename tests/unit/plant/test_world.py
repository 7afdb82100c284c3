"""The disturbance, and the integration of the true dynamics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from phalanx.plant.disturbance import KnottedDisturbance, SwarmDisturbance
from phalanx.plant.world import DisturbanceKnot, IntegrationSteps, World
from phalanx.scenario.agents import Disturbance
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm, build_swarm

MODEL = Disturbance(bound=1.73, every=0.2)
times = st.floats(0.0, 20.0)


def phi(t: float, model: Disturbance = MODEL, n: int = 3) -> np.ndarray:
    return KnottedDisturbance(0, "1", model, n).line(t).at(t)


@given(times, st.integers(1, 6))
def test_the_disturbance_stays_in_its_ball(t, n):
    assert np.linalg.norm(phi(t, n=n)) <= 1.73 * (1 + 1e-12)


def test_the_disturbance_uses_its_ball():
    sizes = [np.abs(phi(t)).max() for t in np.arange(0, 200, 0.2)]
    assert max(sizes) > 0.97 * 1.73 / np.sqrt(3)


@given(times, st.floats(1e-9, 1e-3))
def test_the_disturbance_is_continuous(t, dt):
    steepest = 2 * 1.73 / 0.2
    assert np.linalg.norm(phi(t + dt) - phi(t)) <= steepest * dt * 1.001 + 1e-12


@pytest.mark.parametrize("every", [0.2, 0.1, 0.07, 1 / 3])
def test_at_a_knot_the_next_line_begins_where_the_last_one_ended(every):
    source = KnottedDisturbance(0, "1", Disturbance(bound=1.0, every=every), 3)
    t = 0.0
    for _ in range(500):
        line = source.line(t)
        assert line.begin <= t < line.end
        after = source.line(line.end)
        assert line.at(line.end) == pytest.approx(after.at(line.end), abs=1e-9)
        t = line.end


@given(st.lists(times, min_size=1, max_size=20))
def test_the_disturbance_does_not_depend_on_the_order_of_asking(order):
    source = KnottedDisturbance(0, "1", MODEL, 3)
    for t in order:
        assert (source.line(t).at(t) == phi(t)).all()


def test_agents_are_disturbed_differently_and_no_bound_means_none():
    one, other = (KnottedDisturbance(0, name, MODEL, 3).line(0.1).value for name in "12")
    assert (one != other).all()
    assert not phi(0.3, Disturbance(bound=0.0)).any()


def test_the_swarms_disturbance_stacks_its_agents():
    swarm = scenario(["agents.1.disturbance.every=0.13"])
    stacked = SwarmDisturbance(swarm)
    for t in (0.0, 0.05, 0.13, 0.2, 0.31):
        line = stacked.line(t, swarm.start())
        each = [
            KnottedDisturbance(0, name, swarm.group(i)[0].disturbance, 3).line(t)
            for i, name in enumerate(swarm.names)
        ]
        assert line.end == min(l.end for l in each)
        middle = (t + line.end) / 2
        assert line.at(middle) == pytest.approx(np.concatenate([l.at(middle) for l in each]))


def scenario(overrides: list[str]) -> Swarm:
    return build_swarm(load("unicycles", overrides))


U = np.array([[3.0, 1.9], [-2.0, 1.0], [4.0, -2.0], [1.0, 0.5], [2.0, -1.0]])


def world(swarm: Swarm) -> World:
    world = World(swarm)
    for i, u in enumerate(U):
        world.apply(i, u)
    return world


def truly(swarm: Swarm, t: float) -> np.ndarray:
    """The unicycles under U by an adaptive solver of order 8, knot by knot."""
    sources = [
        KnottedDisturbance(0, name, swarm.group(i)[0].disturbance, 3)
        for i, name in enumerate(swarm.names)
    ]

    def field(time: float, x: np.ndarray, lines: list) -> np.ndarray:
        heading = x[2::3]
        rates = np.stack([U[:, 0] * np.cos(heading), U[:, 0] * np.sin(heading), U[:, 1]], axis=1)
        return (rates + [line.at(time) for line in lines]).ravel()

    x, begin = swarm.start(), 0.0
    while begin < t:
        lines = [source.line(begin) for source in sources]
        end = min(t, *(line.end for line in lines))
        x = solve_ivp(field, (begin, end), x, "DOP853", args=(lines,), rtol=1e-13, atol=1e-13).y[
            :, -1
        ]
        begin = end
    return x


def test_the_world_follows_the_continuous_dynamics():
    swarm = scenario([])
    own = world(swarm)
    own.advance(1.0)
    assert own.x == pytest.approx(truly(swarm, 1.0), abs=1e-11)


def test_the_integration_is_of_fourth_order():
    """Big inputs make the error visible at steps that the scenario file allows.

    Halving the step divides the error by 16; a third-order method would divide it by 8.
    """
    global_u = U * [400.0, 150.0]
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        swarm = scenario([f"time.integration_step={step}", "agents.0.disturbance.bound=0.0"])
        own = World(swarm)
        for i, u in enumerate(global_u):
            own.apply(i, u)
        own.advance(0.128)
        errors.append(np.abs(own.x - exactly(swarm, global_u, 0.128)).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.15)


def exactly(swarm: Swarm, u: np.ndarray, t: float) -> np.ndarray:
    sources = [
        KnottedDisturbance(0, name, swarm.group(i)[0].disturbance, 3)
        for i, name in enumerate(swarm.names)
    ]
    lines = [source.line(0.0) for source in sources]

    def field(time: float, x: np.ndarray) -> np.ndarray:
        heading = x[2::3]
        rates = np.stack([u[:, 0] * np.cos(heading), u[:, 0] * np.sin(heading), u[:, 1]], axis=1)
        return (rates + [line.at(time) for line in lines]).ravel()

    return solve_ivp(field, (0.0, t), swarm.start(), "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]


@given(st.lists(st.floats(0.0, 0.7), max_size=12))
@settings(max_examples=10)
def test_advancing_in_pieces_gives_the_state_of_advancing_at_once(stops):
    whole, pieces = world(SWARM), world(SWARM)
    whole.advance(0.7)
    for stop in [*sorted(stops), 0.7]:
        pieces.advance(stop)
    assert pieces.t == whole.t == 0.7
    assert pieces.x == pytest.approx(whole.x, abs=1e-9)


SWARM = scenario([])


def test_the_world_starts_at_the_scenarios_start_with_actuators_at_zero():
    own = World(SWARM)
    assert (own.x == SWARM.start()).all()
    still = World(scenario(["agents.0.disturbance.bound=0.0", "agents.1.disturbance.bound=0.0"]))
    before = still.x
    still.advance(0.5)
    assert (still.x == before).all()


def test_the_truth_is_seen_at_every_step_of_at_most_a_millisecond():
    own = world(SWARM)
    own.advance(0.45)
    seen = own.take_seen()
    assert own.take_seen() == []
    truths = [s for s in seen if isinstance(s, IntegrationSteps)]
    steps = np.concatenate([s.times for s in truths])
    assert steps[0] == 0.0
    assert steps[-1] == pytest.approx(0.45)
    assert np.diff(steps).max() <= 1e-3 * (1 + 1e-9)
    assert np.diff(steps).min() > 0
    knots = [s.t for s in seen if isinstance(s, DisturbanceKnot)]
    assert knots == pytest.approx([0.0, 0.2, 0.4])
    p = own.x.reshape(5, 3)
    output = p[:, :2] + 0.25 * np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    first = 1.0 - np.sum((output[0] - output[1]) ** 2)
    assert truths[-1].h[-1][0] == pytest.approx(first)
    assert (truths[-1].h_tot >= truths[-1].h.max(axis=1)).all()
