"""A hub of its own: the plant meets the agents there, and may do there what it needs alone."""

import contextlib
from pathlib import Path

import pytest
import zenoh

import phalanx
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.recording.read import Recording, UnreadableRecordingError, read
from phalanx.scenario.load import load
from phalanx.wire.session import open_client
from tests.process.runs import wait_for
from tests.process.swarm.programs import Programs

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


@pytest.fixture
def started(tmp_path: Path):
    running: list[Programs] = []

    def start(agents: int, *scenario: str) -> Programs:
        running.append(Programs(tmp_path, agents, *scenario))
        return running[-1]

    yield start
    for programs in running:
        programs.end()


def test_a_run_at_a_router_is_the_run_without_one(started) -> None:
    programs = started(2, "one-on-one", "--set", "duration=0.3")
    programs.start_members()
    assert programs.summary().trajectory == alone("duration=0.3").trajectory


def test_an_agent_that_comes_again_sooner_than_the_scenario_restarts_it_is_the_one(started) -> None:
    """Containers come so, which their engine restarts whenever they fail."""
    dies = 'faults=[{kind="restart", at=0.1, for=0.4, agents=["2"]}]'
    programs = started(2, "one-on-one", "--set", "duration=0.6", "--set", dies)
    programs.start_members("--speed", "0.05")
    programs.started[-1].wait()
    programs.started.append(programs.start("agent", "2", "--connect", programs.endpoint))
    summary = programs.summary()
    assert summary.trajectory == alone("duration=0.6", dies).trajectory


def alone(*overrides: str) -> Summary:
    """The same run in one process."""
    return phalanx.run(phalanx.load("one-on-one", overrides), engine="in-process").summary


@pytest.mark.parametrize(("identity", "heard"), [(PLANT, True), ("2", False)])
def test_only_the_plant_may_hand_out_samples(started, identity: str, heard: bool) -> None:
    programs = started(0, "unicycles")
    agent = Membership("r", programs.endpoint, b"s", "1")
    key, came = agent.keys.sample("1"), []
    own_key = agent.keys.broadcast("2", "1")
    one_self = Membership("r", programs.endpoint, b"s", identity)
    with (
        open_client(agent.endpoint, 60.0, agent.credentials) as listening,
        open_client(agent.endpoint, 60.0, one_self.credentials) as putting,
    ):
        handler = zenoh.handlers.Callback(lambda m: came.append(str(m.key_expr)), indirect=False)
        listening.declare_subscriber(key, handler)
        listening.declare_subscriber(own_key, handler)

        def put_and_see() -> bool:
            for each in (key, own_key):
                putting.put(each, b"payload", congestion_control=zenoh.CongestionControl.BLOCK)
            return (key if heard else own_key) in came

        # One comes through, so the other was refused and not late: they are in order.
        wait_for(put_and_see)
    assert (key in came) is heard
    assert (own_key in came) is not heard


def test_a_run_in_real_time_outlives_its_router(started) -> None:
    programs = started(2, "one-on-one", "--set", "duration=600.0")
    programs.start_members("--real-time", "1")
    wait_for(lambda: len(recorded(programs).steps) > 100)
    programs.restart_router()
    wait_for(lambda: len(times(recorded(programs), "is back")) == 2)
    back = times(recorded(programs), "is back")
    wait_for(lambda: agents_after(recorded(programs), max(back) + 1.0) == {"1", "2"})
    programs.plant.terminate()
    summary = programs.summary()
    assert summary.outcome is Outcome.STOPPED
    lost = times(recorded(programs), "is lost")
    assert len(lost) == 2
    between = [s for s in recorded(programs).steps if max(lost) < s.t_apply < min(back)]
    assert not between, "their actuators held what they had"
    assert summary.punctuality.unanswered + summary.punctuality.missed > 0


def recorded(programs: Programs) -> Recording:
    """Read the recording as it is now."""
    with contextlib.suppress(UnreadableRecordingError):
        return read(programs.out)
    return Recording(programs.out, load("one-on-one"), {})


def times(recording: Recording, event: str) -> list[float]:
    """Return the times of the log's lines with a text."""
    return [line.t for line in recording.log if event in line.text]


def agents_after(recording: Recording, t: float) -> set[str]:
    """Return the agents whose inputs took effect after t."""
    return {step.agent for step in recording.steps if step.t > t}
