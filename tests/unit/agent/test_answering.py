"""Invalid messages to an agent are dropped and counted, without an answer or a crash."""

import math
import os
import time
from queue import SimpleQueue
from typing import Any

import msgspec
import pytest
from phalanx_agent.answering import SampleAnswering, pending_watchdog
from phalanx_agent.clock import clock_of
from phalanx_agent.step import Answer, ControlStep

from phalanx.faults.commands import ActiveCommands
from phalanx.messages.keys import Keys
from phalanx.messages.kinds import Actuation, Broadcast, Sample
from phalanx.messages.membership import Membership
from tests.unit.swarms import rows_of_scenario

KEYS = Keys("r")
SAMPLE, HEARD = KEYS.sample("1"), KEYS.broadcast("2", "1")
PLANT = Membership("r", "", b"secret").sealer
NAMES = ("1", "2", "3", "4", "5")
INSIDER = Membership("r", "", b"secret").of("2", ("2",), NAMES)
AGENTS = len(NAMES)
EVERYBODY = tuple(range(AGENTS))


def a_sample(**changes: Any) -> Sample:
    """The first that agent 1 gets."""
    sample = Sample(
        k=0, t=0.0, seen=EVERYBODY, x=bytes(8 * 3 * AGENTS), hearers=(1, 2),
    )  # fmt: skip
    return msgspec.structs.replace(sample, **changes)


def a_broadcast(**changes: Any) -> Broadcast:
    return msgspec.structs.replace(Broadcast(k=0, t_apply=0.0, u=(0.0, 0.0)), **changes)


def by_another_key(sample: Sample) -> bytes:
    """Sealed by another agent, which has its own key and the shared one."""
    knows = Membership("r", "", held={"1": INSIDER.key_of("2"), "": INSIDER.key_of("")})
    return knows.sealer.seal(SAMPLE, sample)


NAN = msgspec.structs.replace(a_sample(), x=b"\xff" * (8 * 3 * AGENTS))
SAMPLES = {
    "nothing": b"",
    "noise": os.urandom(300),
    "a command by another agent": by_another_key(a_sample(commands=ActiveCommands(die=True))),
    "an input for a sample": PLANT.seal(SAMPLE, Actuation(k=0, t_apply=0.0, u=(0.0, 0.0))),
    "a state of another size": PLANT.seal(SAMPLE, a_sample(x=bytes(8))),
    "a state that is no number": PLANT.seal(SAMPLE, NAN),
    "a time that is no number": PLANT.seal(SAMPLE, a_sample(t=math.nan)),
    "an endless time": PLANT.seal(SAMPLE, a_sample(t=math.inf)),
    "before the beginning": PLANT.seal(SAMPLE, a_sample(k=-1)),
    "a loss of nan": PLANT.seal(SAMPLE, a_sample(commands=ActiveCommands(loss=math.nan))),
    "a loss above one": PLANT.seal(SAMPLE, a_sample(commands=ActiveCommands(loss=1.5))),
    "a delay into the past": PLANT.seal(SAMPLE, a_sample(commands=ActiveCommands(delay=-1.0))),
    "an endless delay": PLANT.seal(SAMPLE, a_sample(commands=ActiveCommands(delay=math.inf))),
}
EVERY, FROM_4 = KEYS.broadcast("*", "1"), KEYS.broadcast("4", "1")
FROM_3 = KEYS.broadcast("3", "1")
BY_3 = Membership("r", "", held={"2>1": INSIDER.key_of("3>2")}).sealer
BROADCASTS = {
    "noise": (HEARD, os.urandom(60)),
    "an input that is no number": (HEARD, PLANT.seal(HEARD, a_broadcast(u=(math.nan, 0.0)))),
    "an input too many": (HEARD, PLANT.seal(HEARD, a_broadcast(u=(0.0,) * 3))),
    "an input too few": (HEARD, PLANT.seal(HEARD, a_broadcast(u=(0.0,)))),
    "from the past": (HEARD, PLANT.seal(HEARD, a_broadcast(k=-1))),
    "from the far future": (HEARD, PLANT.seal(HEARD, a_broadcast(k=10**6))),
    "under every name": (EVERY, PLANT.seal(EVERY, a_broadcast())),
    "under no name": ("**", PLANT.seal("**", a_broadcast())),
    "of one that is not listened to": (
        FROM_4, PLANT.seal(FROM_4, a_broadcast())),
    "sealed by a third": (HEARD, BY_3.seal(HEARD, a_broadcast())),
}  # fmt: skip


class Agent:
    """Agent 1 of Simulation 1, and what it answered."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.failures: SimpleQueue[Exception] = SimpleQueue()
        self.step = ControlStep(rows_of_scenario("unicycles"), 0)
        sealer = Membership("r", "", b"secret").of("1", ("1",), NAMES).sealer
        self.answering = SampleAnswering(self.step, sealer, self.answers.append, self.fail)

    def fail(self) -> None:
        self.failures.put(self.answering.error)


@pytest.fixture
def agent() -> Agent:
    return Agent()


@pytest.mark.parametrize("which", SAMPLES)
def test_a_sample_that_cannot_be_the_plants_next_is_dropped(agent: Agent, which: str) -> None:
    agent.answering.on_sample(SAMPLE, SAMPLES[which])
    assert agent.answers == []
    assert agent.step.rejected == 1
    agent.answering.on_sample(SAMPLE, PLANT.seal(SAMPLE, start(agent)))
    assert len(agent.answers) == 1, "and the true one is answered"


@pytest.mark.parametrize("which", BROADCASTS)
def test_a_broadcast_that_cannot_be_its_senders_is_dropped(agent: Agent, which: str) -> None:
    agent.answering.on_broadcast(*BROADCASTS[which])
    assert agent.step.rejected == 1
    assert agent.step.inbox.lacks({1: (0, 0)})


def test_a_broadcast_that_came_before_is_dropped(agent: Agent) -> None:
    for _ in range(2):
        agent.answering.on_broadcast(HEARD, PLANT.seal(HEARD, a_broadcast()))
    assert agent.step.rejected == 1


@pytest.mark.slow
def test_one_who_fills_inboxes_is_bounded_by_what_the_run_can_hold(agent: Agent) -> None:
    for k in range(20_000):
        agent.answering.on_broadcast(HEARD, INSIDER.sealer.seal(HEARD, a_broadcast(k=k)))
    accepted = 20_000 - agent.step.rejected
    duration = agent.step.swarm.scenario.duration
    assert accepted == agent.step.swarm.clock(1).most_samples(duration)
    assert accepted > duration / 0.008


def start(agent: Agent) -> Sample:
    return a_sample(x=agent.step.swarm.start().astype("<f8").tobytes())


def test_one_who_waits_for_a_broadcast_that_is_withheld_says_whose(agent: Agent) -> None:
    first = start(agent)
    agent.answering.on_sample(SAMPLE, PLANT.seal(SAMPLE, first))
    heard = {"senders": (1, 2), "since": (0, 0), "latest": (0, 0)}
    second = msgspec.structs.replace(first, k=1, t=0.01, **heard)
    agent.answering.on_broadcast(HEARD, PLANT.seal(HEARD, a_broadcast()))
    agent.answering.on_sample(SAMPLE, PLANT.seal(SAMPLE, second))
    answered = msgspec.structs.replace(agent.answering.pending, sample=first)
    agent.answering.give_up_waiting(answered)
    assert agent.failures.empty()
    with pending_watchdog(0.01, [agent.answering]):
        given_up = agent.failures.get(timeout=60.0)
    assert "agent 1 waits at sample 1" in str(given_up)
    assert "broadcast 0 of agent 3 did not come" in str(given_up)
    assert given_up.sample == second
    assert len(agent.answers) == 1
    agent.answering.on_broadcast(FROM_3, PLANT.seal(FROM_3, a_broadcast()))
    assert len(agent.answers) == 1, "it is too late now"


def test_in_real_time_a_clock_goes_on_from_its_sample_at_the_runs_pace():
    before = time.monotonic()
    clock, after = clock_of(a_sample(t=5.0, pace=1e6)), time.monotonic()
    while (later := time.monotonic()) == after:
        pass
    least, now, most = later - after, clock.now(), time.monotonic() - before
    assert 5.0 + 1e6 * least <= now <= 5.0 + 1e6 * most
    assert clock_of(a_sample(t=5.0)).now() == -math.inf, "in lockstep no broadcast is late"
