"""r*, Λ and the radius of sensors, for two robots that meet."""

import pytest

from phalanx.guarantee.radio_reach import radio_reach
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from tests.unit.swarms import checked

CALM = {"faults": [], "network.loss": 0.0, "network.delay": 0.0, "agents.0.radio.every": 2}


def reach_of(**overrides):
    return radio_reach(build_swarm(load("radio", {**CALM, **overrides})))


def test_numbers_are_those_of_two_robots_that_meet_at_their_laws_speed():
    reach = reach_of(**{"agents.0.clock": {"period": 0.05, "jitter": 0.0}})
    stopping = 3.0**2 / (2.0 * 4.0) + 0.05 * 3.0
    assert reach.speed == 6.0
    assert reach.slack == pytest.approx(2.0 * 0.05 * 3.0)
    assert reach.age == pytest.approx(0.05, abs=0.01)  # half of a period of 0.1 s
    assert reach.ratio == pytest.approx(6.0 * reach.age / reach.slack)
    kappa = 1.0 / (2.718281828 * 0.05)
    assert reach.radius == pytest.approx(1.0 + 2.0 * stopping + 6.0 / kappa)
    assert reach.sensor == pytest.approx(1.0 + 2.0 * stopping + 6.0 * 0.05)


def test_knowledge_is_older_with_loss_and_with_delay_and_in_a_partition():
    calm = reach_of()
    assert reach_of(**{"network.delay": 0.1}).age == pytest.approx(calm.age + 0.1, abs=0.01)
    assert reach_of(**{"network.loss": 0.7}).age > 2.0 * calm.age
    cut = {"kind": "partition", "at": 1.0, "for": 20.0, "groups": [["1", "2"]]}
    assert reach_of(faults=[cut]).age > 8.0


def test_a_goal_or_a_start_that_moves_shows_a_speed_and_without_any_there_are_no_numbers():
    law = {"type": "track", "gains": [1.0, 2.0]}
    assert reach_of(**{"agents.0.law": law}) is None
    path = {"type": "path", "points": [[9.0, 0.0], [0.0, 0.0]], "speed": 1.5}
    moving = reach_of(**{"agents.0.law": law, "agents.0.goal.0": path})
    assert moving.speed == pytest.approx(3.0)
    assert radio_reach(build_swarm(load("one-on-one"))) is None


@pytest.mark.slow
def test_check_says_them():
    (sentence,) = [words for words in checked("radio").words if words.startswith("Radio:")]
    assert "Λ = 5.17" in sentence
    assert "r* = 5.3 m" in sentence
    assert "3.85 m" in sentence
