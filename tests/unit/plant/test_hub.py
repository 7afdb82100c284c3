"""The hub's waits for agents."""

from itertools import count

import pytest
from phalanx_plant.hub import hub
from phalanx_plant.hub.hub import Countdown, LockstepHub
from phalanx_plant.world.events import SwarmBrokenError

from phalanx.messages.membership import Membership
from phalanx.wire.session import free_endpoint
from tests.unit.swarms import swarm_of_scenario


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
