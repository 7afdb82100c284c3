"""Agents that join, and the hub's waits for them."""

from itertools import count

import pytest
from phalanx_plant.hub import hub
from phalanx_plant.hub.hub import Countdown, Joining, LockstepHub
from phalanx_plant.world.events import SwarmBrokenError

from phalanx.messages.keys import Keys
from phalanx.messages.membership import Membership
from phalanx.wire.session import free_endpoint
from tests.unit.swarms import swarm_of_scenario

KEYS = Keys("run")


@pytest.fixture
def joining() -> Joining:
    return Joining(swarm_of_scenario("unicycles"), may_leave=False)


def test_an_agent_of_another_scenario_does_not_join(joining: Joining):
    assert "runs another scenario" in (joining.on_token(KEYS.alive("1", "0123"), True) or "")
    assert joining.missing() == ("1", "2", "3", "4", "5")


def test_an_agent_that_joined_is_missed_when_its_own_token_goes(joining: Joining):
    token = KEYS.alive("1", joining.digest)
    assert joining.on_token(token, True) is None
    assert joining.missing() == ("2", "3", "4", "5")
    assert joining.on_token(KEYS.alive("1", "0123"), False) is None, "another's"
    joining.begin()
    assert joining.on_token(token, False) == "agent 1 died: see its log"


def test_before_the_run_begins_an_agent_may_go_and_come_back(joining: Joining):
    token = KEYS.alive("1", joining.digest)
    joining.on_token(token, True)
    assert joining.on_token(token, False) is None
    assert joining.missing() == ("1", "2", "3", "4", "5")
    assert joining.gone_for(0.0) == ["1"]
    joining.on_token(token, True)
    assert joining.missing() == ("2", "3", "4", "5")
    assert joining.gone_for(0.0) == []


def test_an_agent_lost_before_the_run_began_is_given_up_after_a_while():
    wall = [100.0]
    joining = Joining(swarm_of_scenario("unicycles"), may_leave=False, now=lambda: wall[0])
    token = KEYS.alive("1", joining.digest)
    joining.on_token(token, True)
    joining.on_token(token, False)
    wall[0] += 3.9
    assert joining.gone_for(4.0) == []
    wall[0] += 0.2
    assert joining.gone_for(4.0) == ["1"]


def test_an_agent_that_reports_a_failure_and_leaves_is_lost_with_its_reason_once(joining: Joining):
    assert joining.on_failure("1", "agent 1 failed") == "agent 1 failed", "the run needs it"
    joining = Joining(swarm_of_scenario("unicycles"), may_leave=True)
    token, other = KEYS.alive("1", joining.digest), KEYS.alive("2", joining.digest)
    joining.on_token(token, True)
    joining.on_token(other, True)
    assert joining.on_failure("1", "agent 1 failed") is None
    assert joining.take_changes() == [], "it is still there"
    for alive in (False, True, False):
        joining.on_token(token, alive)
    joining.on_token(other, False)
    lost, back = (0, False, "agent 1 failed"), (0, True, "")
    assert joining.take_changes() == [lost, back, (0, False, ""), (1, False, "")]


@pytest.mark.parametrize("key", ["phalanx/run/alive/*/x", "phalanx/**", "1", KEYS.alive("9", "x")])
def test_tokens_of_no_agent_are_ignored(joining: Joining, key: str):
    assert joining.on_token(key, True) is None
    assert len(joining.missing()) == 5


def test_an_agent_that_was_ordered_to_exit_exits_once_and_another_may_come_at_once(
    joining: Joining,
):
    token = KEYS.alive("2", joining.digest)
    joining.on_token(token, True)
    joining.begin()
    joining.dismiss("2")
    assert joining.exits("2")
    assert joining.on_token(token, False) is None
    assert not joining.exits("2")
    assert not joining.has("2")
    joining.on_token(token, True)
    assert joining.has("2")
    assert not joining.exits("2"), "the new one is not taken for the old"
    assert joining.on_token(token, False) == "agent 2 died: see its log"


def polls(times: list[float], seconds: float, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return whether a wait has ended at each time after the first [s]."""
    clock = iter(times)
    monkeypatch.setattr(hub.time, "monotonic", lambda: next(clock))
    left = Countdown(seconds)
    return [left.ended() for _ in times[1:]]


def test_a_wait_ends_when_its_time_has_passed(monkeypatch):
    assert polls([5.0, 5.2, 5.4, 5.6], 0.5, monkeypatch) == [False, False, True]


def test_time_in_which_the_plant_was_stopped_does_not_count(monkeypatch):
    """Ctrl-Z does that; answers that were sent meanwhile are still to be read."""
    assert polls([5.0, 5.2, 905.2, 905.4], 1.0, monkeypatch) == [False, False, False]


def test_an_agent_that_did_not_answer_in_time_is_not_waited_for_again():
    """All reports that are missing at the end of a broken run are its own."""
    swarm, looked = swarm_of_scenario("one-on-one", "time.timeout=0.5"), count()
    membership = Membership("run", free_endpoint(), b"0" * 32)
    with LockstepHub(swarm, membership, lambda: next(looked) and None) as waiting:
        for _ in range(20):
            with pytest.raises(SwarmBrokenError, match="agent 2 did not report on"):
                waiting.await_telemetry(1, 0)
    assert next(looked) < 40, "a wait of half a second looks up three times or more"
