"""States ahead of the answers: equal to the world's to the last bit, where they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple
from phalanx_plant.clock.lookahead import Lookahead
from phalanx_plant.world.world import World

from tests.unit.swarms import rows_of_scenario

EVENTS = np.cumsum([0.0013, 0.0002, 0.004, 0.0031, 0.0007, 0.19, 0.0009, 0.006])
"""Instants [s] of any distance, and a knot of the disturbances (every 0.2 s) among them."""


def both(radius: float = 2.0, *overrides: str) -> tuple[World, World, Lookahead]:
    """A world that knows every input at once, and another with a lookahead."""
    rows = rows_of_scenario("unicycles", *overrides)
    behind = World(rows)
    return World(rows), behind, Lookahead(behind, np.full(5, radius))


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_known_states_are_the_worlds_however_late_the_answers_of_others(seed):
    rng = np.random.default_rng(seed)
    world, behind, ahead = both()
    late: list[tuple[int, int, np.ndarray | None]] = []  # (until event, agent, input)
    for event, t in enumerate(EVENTS):
        world.advance(t)
        ahead.advance(t)
        for due in [entry for entry in late if entry[0] <= event]:
            late.remove(due)
            ahead.end_unknown(due[1], due[2])
        unknown = set(ahead.unknown)
        for i, (state, truth) in enumerate(
            zip(behind.integration.x.reshape(5, 3), world.x.reshape(5, 3), strict=True)
        ):
            assert np.isnan(state).all() if i in unknown else np.array_equal(state, truth)
        for i in set(range(5)) - unknown:
            if rng.random() < 0.5:
                lost = rng.random() < 0.3
                u = None if lost else rng.uniform(-1.0, 1.0, 2)
                if u is not None:
                    world.apply(i, u)
                ahead.begin_unknown(i)
                late.append((event + int(rng.integers(1, 4)), i, u))
    for _, i, u in late:
        ahead.end_unknown(i, u)
    ahead.reach(EVENTS[-1])
    assert (behind.t, behind.x.tobytes()) == (world.t, world.x.tobytes())
    for piece, expected in zip(behind.take_history(), world.take_history(), strict=True):
        assert [np.array(part).tobytes() for part in astuple(piece)] == [
            np.array(part).tobytes() for part in astuple(expected)
        ]


def test_the_world_follows_up_to_the_oldest_pending_input():
    world, behind, ahead = both()
    ahead.advance(0.01)
    ahead.begin_unknown(4)
    ahead.advance(0.03)
    world.advance(0.01)
    ahead.reach(0.01)
    assert (behind.t, behind.x.tobytes()) == (0.01, world.x.tobytes())
    ahead.end_unknown(4, np.array([1.0, 0.5]))
    world.apply(4, np.array([1.0, 0.5]))
    world.advance(0.03)
    ahead.reach(0.03)
    assert behind.x.tobytes() == world.x.tobytes()


def test_only_agents_that_may_be_in_sight_by_now_are_required():
    """Agents 1 and 2 of Simulation 1 are 4.7 m apart at first; a unicycle goes 4 m/s."""
    *_, ahead = both(radius=4.0)
    ahead.begin_unknown(1)
    assert ahead.required([0]) == []
    assert ahead.required([1]) == [1], "no agent is sampled again before it has answered"
    ahead.advance(0.05)
    assert ahead.required([0]) == []
    ahead.advance(0.12)  # .54 m from being seen: .48 m by its own speed, .70 m if it is pushed
    assert ahead.required([0]) == [1]
    ahead.advance(0.2)
    assert ahead.required([0]) == [1]
    assert ahead.required([4]) == []
    assert ahead.required([4, 0]) == [1], "one that may see it is enough"
    ahead.end_unknown(1, np.array([0.0, 0.0]))
    assert ahead.required([0]) == []


@pytest.mark.parametrize("radius", [0.0, 100.0])
def test_an_agent_that_has_not_moved_is_required_by_its_position(radius):
    *_, ahead = both(radius)
    ahead.begin_unknown(2)
    assert bool(ahead.required([0])) == (radius > 0.0)


def test_an_agent_of_unbounded_travel_is_required_for_all():
    own = 'agents.0.dynamics={ type = "tests.unit.theory.users_own:OutputUnicycle" }'
    *_, ahead = both(0.0, own)
    ahead.begin_unknown(2)
    assert ahead.required([0]) == [2]


def test_a_pending_agent_requires_itself_alone_at_first():
    *_, ahead = both(radius=np.inf)
    ahead.begin_unknown(1)
    ahead.begin_unknown(2)
    assert ahead.required([1]) == [1], "its position depends on no other agent"
    assert ahead.required([0]) == [1, 2]
    ahead.end_unknown(1, None)
    assert ahead.required([1]) == [2]
