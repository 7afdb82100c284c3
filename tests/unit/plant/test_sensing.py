"""Sensing, compared with plain distances; and the states in a sample."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from phalanx_plant.sampling.sensing import Sensing, Visibility

from phalanx.launcher.simulation import Simulation
from phalanx.messages.kinds import Sample
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from tests.unit.swarms import swarm_of_scenario

LIMITED = ("safety.neighbourhood=5.0", "agents.1.sensing=8.0")


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_an_agent_sees_those_within_its_radius_and_those_that_see_it_and_listen_receive(seed):
    swarm = swarm_of_scenario("unicycles", *LIMITED)
    x = np.random.default_rng(seed).uniform(-6, 6, 15)
    pose = x.reshape(5, 3)
    p = pose[:, :2] + 0.25 * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    radius = [5.0, 5.0, 5.0, 8.0, 8.0]
    distances = np.linalg.norm(p[:, None] - p, axis=2)
    for i, visible in enumerate(Sensing(swarm).visible(swarm.positions(x), range(5))):
        assert visible.seen == tuple(j for j in range(5) if distances[i, j] < radius[i])
        heard = [j for j in range(3) if i < 3 and j != i and distances[i, j] < 5.0]
        assert list(visible.hearers) == heard


def test_a_broadcast_goes_to_no_agent_that_its_sender_does_not_see():
    scenario = load("unicycles", ["safety.neighbourhood=9.0"])
    near, far = scenario.agents[0], scenario.agents[1]
    short = far.model_copy(update={"role": "normal", "sensing": 3.0})
    swarm = build_swarm(scenario.model_copy(update={"agents": (near, short)}))
    x = np.zeros(15)
    x[12] = 5.0  # of the last agent
    views = Sensing(swarm).visible(swarm.positions(x), range(5))
    assert views[0] == Visibility((0, 1, 2, 3, 4), (1, 2, 3))
    assert views[4] == Visibility((4,), ())


def test_without_a_radius_all_agents_see_all():
    found = Sensing(swarm_of_scenario("unicycles")).visible(np.zeros((5, 2)), [0, 3])
    assert found == [Visibility((0, 1, 2, 3, 4), (1, 2)), Visibility((0, 1, 2, 3, 4), ())]


def test_an_agent_without_a_radius_sees_all_though_others_have_one():
    sensing = Sensing(swarm_of_scenario("unicycles", "agents.1.sensing=1.0"))
    p = np.array([[10.0 * i, 0.0] for i in range(5)])
    assert [visible.seen for visible in sensing.visible(p, [0, 3])] == [(0, 1, 2, 3, 4), (3,)]


def test_one_of_several_within_its_radius_is_seen():
    sensing = Sensing(swarm_of_scenario("unicycles", *LIMITED))
    p = 20.0 + np.array([[0.0, 0.0], [4.0, 0.0], [6.0, 0.0], [0.0, 7.0], [0.0, 9.0]])
    assert sensing.sees(p, 0, [1, 2])
    assert not sensing.sees(p, 0, [2, 3])
    assert sensing.sees(p, 3, [0])


def test_an_agent_exactly_a_radius_away_is_seen_and_receives():
    sensing = Sensing(swarm_of_scenario("unicycles", *LIMITED))
    p = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.1], [9.0, 0.0], [9.0, 9.0]])
    assert sensing.visible(p, [0]) == [Visibility((0, 1), (1,))]
    assert sensing.sees(p, 0, [1])


def test_a_dead_or_paused_agent_is_seen_and_receives_nothing():
    assert Visibility((0, 1, 2), (1, 2)).without({2}) == Visibility((0, 1, 2), (1,))


def test_one_controller_sees_everything_and_receives_no_broadcast():
    swarm = swarm_of_scenario("unicycles", "safety.control=centralised", LIMITED[0])
    assert Sensing(swarm).visible(np.zeros((5, 2)), [1]) == [Visibility((0, 1, 2, 3, 4), ())]


@pytest.mark.parametrize("visible", [(0, 1, 2, 3, 4), (1, 4), (2,)])
def test_the_states_of_those_seen_are_packed_and_found_again_and_no_others(visible):
    states = StateCodec(swarm_of_scenario("unicycles"))
    x = np.random.default_rng(1).normal(size=15)
    packed = states.pack(x, visible)
    assert len(packed) == 8 * 3 * len(visible)
    unpacked = states.unpack(packed, visible).reshape(5, 3)
    for l, state in enumerate(x.reshape(5, 3)):
        assert np.array_equal(unpacked[l], state) if l in visible else np.isnan(unpacked[l]).all()
    last = visible[-1]
    assert np.array_equal(states.unpack_one(last, packed, visible), x.reshape(5, 3)[last])


@pytest.mark.parametrize(
    ("seen", "size"),
    [((0, 1), 47), ((0, 1), 24), ((0, 1), 72), ((1, 0), 48), ((0, 0), 48), ((0, 5), 48)],
)
def test_what_cannot_be_the_states_of_those_seen_is_refused(seen, size):
    with pytest.raises(ValueError, match="expected"):
        StateCodec(swarm_of_scenario("unicycles")).unpack(bytes(size), seen)


@pytest.mark.slow
def test_what_an_agent_is_sent_does_not_depend_on_who_is_out_of_its_sight():
    few, many = (sent_to_the_formation(far_away) for far_away in (1, 6))
    common = few.keys() & many.keys()
    assert len(common) > 50
    assert {which: few[which] for which in common} == {which: many[which] for which in common}


def sent_to_the_formation(far_away: int) -> dict[tuple[int, int], object]:
    """Return all samples of agents 1, 2 and 3, by agent and number, with adversaries at 500 m.

    Of states their length alone: the events of all agents divide the integration's steps, so that
    last digits differ.
    """
    names = [str(4 + n) for n in range(far_away)]
    starts = [[-500.0, 9.0 * n, 0.0] for n in range(far_away)]
    of_others = {"agents.1.names": names, "agents.1.slots": [], "agents.1.start": starts}
    table = {"duration": 0.3, "safety.neighbourhood": 9.0, **of_others}
    run, samples = Simulation(build_rows(build_swarm(load("unicycles", table)))), {}
    answer = run.agents.send_sample

    def send_sample(i: int, sample: Sample) -> None:
        if i < 3:
            samples[i, sample.k] = replace(sample, x=bytes(len(sample.x)))
        answer(i, sample)

    run.agents.send_sample = send_sample
    run.run()
    return samples
