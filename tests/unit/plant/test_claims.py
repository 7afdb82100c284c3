"""What agents tell one another, held against what their actuators were given."""

from phalanx_plant.judge.claims import Claims, Finding

from phalanx.network.inbox import Claim, Fate
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm

TRUTH, LIE = Claim(0.03, (1.0, 0.5)), Claim(0.03, (-1.0, -0.5))


def claims(**lie: object) -> Claims:
    """Of Simulation 1, where agent 2 lies as told."""
    faults = [{"kind": "lie", "agent": "2", "for": 9.0, **lie}] if lie else []
    return Claims(build_swarm(load("unicycles", {"faults": faults})))


def counted(found: Claims) -> tuple[int, int, float | None]:
    return found.truthful.failed, found.truthful.checked, found.truthful.first


def test_a_claim_is_true_if_it_says_what_the_actuator_was_given_and_from_when_on():
    found = claims()
    found.given(1, 3, TRUTH)
    assert found.heard(0, Fate(1, 3, 0.0, (), TRUTH), 0.04) == Finding()
    for t, false in ((0.05, LIE), (0.06, Claim(0.031, TRUTH.u))):
        assert found.heard(0, Fate(1, 3, 0.0, (), false), t) == Finding(false=True)
    assert counted(found) == (2, 3, 0.05)
    assert found.truthful.note.endswith("false were 2 by 2")


def test_what_was_lost_has_told_nothing():
    found = claims()
    found.given(1, 3, TRUTH)
    found.heard(0, Fate(1, 3, -1.0), 0.04)
    assert counted(found) == (0, 0, None)


def test_a_claim_heard_before_its_input_came_to_the_actuator_is_judged_when_it_has():
    found = claims(says="opposite")
    found.given(1, 2, TRUTH)
    assert found.heard(0, Fate(1, 3, 0.0, (), LIE), 0.04) == Finding()
    assert counted(found) == (0, 0, None)
    found.given(1, 3, TRUTH)
    assert counted(found) == (1, 1, 0.04)
    assert found.faults == {0: 1}


def test_a_declared_lie_is_counted_for_each_peer_that_heard_it():
    found = claims(says="opposite", to=["1"])
    found.given(1, 3, TRUTH)
    assert found.heard(0, Fate(1, 3, 0.0, (), LIE), 0.04) == Finding(True, (0,))
    assert found.heard(2, Fate(1, 3, 0.0, (), TRUTH), 0.04) == Finding()
    # Nobody declared that agent 3 is lied to as well: a lie of the agent's own, or agent 3's.
    assert found.heard(2, Fate(1, 3, 0.0, (), LIE), 0.05) == Finding(True)
    assert found.faults == {0: 1}
    assert counted(found) == (2, 3, 0.04)


def test_what_is_replayed_is_known_from_what_was_given_before():
    found = claims(replay=2)
    old = Claim(0.01, (4.0, 0.0))
    for k, given in ((1, old), (3, TRUTH)):
        found.given(1, k, given)
    said = Claim(TRUTH.t_apply, old.u)
    assert found.heard(0, Fate(1, 3, 0.0, (), said), 0.04).lies == (0,)
