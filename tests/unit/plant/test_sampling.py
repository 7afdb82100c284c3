"""Samples as they are taken, and the effect of commands on them."""

import math

import numpy as np
import pytest
from phalanx_plant.clock.commands import declared
from phalanx_plant.sampling.sampling import Sampling

from phalanx.faults.commands import Command, CommandKind
from phalanx.messages.kinds import Sample
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from tests.unit.swarms import swarm_of_scenario


class Recorded:
    """The agents' processes: the calls in order."""

    def __init__(self) -> None:
        self.calls = list[tuple[str, int]]()
        self.orders = list[Sample]()

    def pause(self, i: int, t: float) -> None:
        self.calls.append(("pause", i))

    def resume(self, i: int, t: float) -> None:
        self.calls.append(("resume", i))

    def kill(self, i: int, order: Sample) -> None:
        self.calls.append(("kill", i))
        self.orders.append(order)

    def restart(self, i: int, t: float) -> None:
        self.calls.append(("restart", i))


class Taking:
    """Samples of Simulation 1's agents, at the start."""

    def __init__(self) -> None:
        swarm = swarm_of_scenario("unicycles")
        self.sampling = Sampling(swarm)
        self.schedule = self.sampling.schedule
        self.processes, self.x, self.p = Recorded(), swarm.start(), swarm.positions(swarm.start())

    def take(self, i: int, t: float) -> Sample:
        (visible,) = self.sampling.sensing.visible(self.p, [i])
        return self.sampling.take(i, t, self.x, visible)[0]

    def apply(self, kind: CommandKind, t: float, agent: str = "2") -> tuple[int, ...]:
        return self.sampling.apply(Command(t, kind, agent), self.x, self.processes).forgotten


def test_a_sample_tells_which_broadcasts_exist_for_it():
    taking = Taking()
    for i in (0, 1, 4):
        assert taking.take(i, 0.0).senders == ()
    second = taking.take(0, 0.01)
    assert (second.k, second.hearers) == (1, (1, 2))
    assert (second.senders, second.since, second.latest) == ((1,), (0,), (0,))


@pytest.mark.parametrize(
    ("ends", "begins", "calls"),
    [
        (CommandKind.FREEZE, CommandKind.THAW, ["pause", "resume"]),
        (CommandKind.KILL, CommandKind.RESTART, ["kill", "restart"]),
    ],
)
def test_a_stopped_agent_neither_samples_nor_receives_until_it_continues(ends, begins, calls):
    taking = Taking()
    for t, kind, tick in ((0.1, ends, np.inf), (0.2, begins, 0.2)):
        taking.apply(kind, t)
        assert taking.schedule.tick(1) == tick
        assert (1 in taking.take(0, t).hearers) == (kind is begins)
    assert taking.processes.calls == [(word, 1) for word in calls]


def test_a_killed_agent_is_ordered_to_exit_and_loses_all_that_it_received():
    taking = Taking()
    taking.take(0, 0.0)
    assert taking.apply(CommandKind.KILL, 0.005) == (0,)
    (order,) = taking.processes.orders
    assert order.commands.die
    assert (order.k, order.seen, np.frombuffer(order.x).tolist()) == (0, (1,), [*taking.x[3:6]])


def test_a_command_without_effect_calls_no_process():
    taking = Taking()
    for kind in (CommandKind.THAW, CommandKind.RESTART):
        taking.apply(kind, 0.1)
    assert taking.processes.calls == []
    assert taking.schedule.tick(1) == 0.0


def test_a_clock_that_is_set_back_ticks_again_only_after_the_last_input_is_due():
    """A period of 10 ms and 2 ms of jitter, an input 4 ms after its sample, and back by 9 ms."""
    back = [{"kind": "clock", "at": 0.001, "agents": ["2"], "step": -0.009}]
    swarm = build_swarm(load("unicycles", {"time.latency": 0.004, "faults": back}))
    schedule = Sampling(swarm).schedule
    for i, due in ((0, 0.012), (1, math.nextafter(0.004, 1.0))):
        schedule.sampled(i, 0.0)
        assert schedule.due(i) == 0.004
        assert 0.004 < schedule.tick(i) <= due


def test_an_agent_takes_no_more_samples_than_its_peers_accept_however_often_it_is_paused():
    pauses = {"kind": "pause", "rate": 95.0, "for": 0.001, "agents": ["2"]}
    slow = {"duration": 16.0, "agents.0.clock.period": 0.2, "faults": [pauses]}
    swarm = build_swarm(load("unicycles", slow))
    schedule = Sampling(swarm).schedule
    for command in sorted(declared(swarm), key=lambda command: command.t):
        while schedule.tick(1) < command.t:
            schedule.sampled(1, schedule.tick(1))
        if command.is_failure:
            schedule.silence(1)
        else:
            schedule.resume(1, command.t)
    assert (
        swarm.clock(1).most_samples(16.0) < schedule.next_number(1) < swarm.broadcasters["2"].most
    )
