"""Samples as they are taken, and what commands do to those who take them."""

import numpy as np
import pytest
from phalanx_plant.sampling.sampling import Sampling, Taken

from phalanx.faults.commands import Command, CommandKind
from phalanx.wire.messages import Sample
from tests.unit.swarms import swarm_of_scenario


class Told:
    """The agents' processes: what each was told, in order."""

    def __init__(self) -> None:
        self.said = list[tuple[str, int]]()
        self.orders = list[Sample]()

    def pause(self, i: int, t: float) -> None:
        self.said.append(("pause", i))

    def resume(self, i: int, t: float) -> None:
        self.said.append(("resume", i))

    def kill(self, i: int, order: Sample) -> None:
        self.said.append(("kill", i))
        self.orders.append(order)

    def restart(self, i: int, t: float) -> None:
        self.said.append(("restart", i))


class Taking:
    """Samples of Simulation 1's agents, at the start."""

    def __init__(self) -> None:
        swarm = swarm_of_scenario("unicycles")
        self.sampling = Sampling(swarm)
        self.schedule = self.sampling.schedule
        self.told, self.x, self.p = Told(), swarm.start(), swarm.positions(swarm.start())

    def take(self, i: int, t: float) -> Taken:
        (sight,) = self.sampling.sensing.sights(self.p, [i])
        return self.sampling.take(i, t, self.x, sight)

    def obey(self, kind: CommandKind, t: float, agent: str = "2") -> tuple[int, ...]:
        return self.sampling.obey(Command(t, kind, agent), self.x, self.told).forgotten


def test_a_sample_tells_which_broadcasts_exist_for_it():
    taking = Taking()
    for i in (0, 1, 4):
        assert taking.take(i, 0.0).sample.latest == (-1,) * 5
    second = taking.take(0, 0.01).sample
    assert (second.k, second.hearers) == (1, (1, 2))
    assert (second.since, second.latest) == ((-1, 0, -1, -1, -1),) * 2


@pytest.mark.parametrize(
    ("ends", "begins", "said"),
    [
        (CommandKind.FREEZE, CommandKind.THAW, ["pause", "resume"]),
        (CommandKind.KILL, CommandKind.RESTART, ["kill", "restart"]),
    ],
)
def test_who_is_stopped_samples_and_hears_no_more_until_it_goes_on(ends, begins, said):
    taking = Taking()
    for t, kind, tick in ((0.1, ends, np.inf), (0.2, begins, 0.2)):
        taking.obey(kind, t)
        assert taking.schedule.tick(1) == tick
        assert (1 in taking.take(0, t).sample.hearers) == (kind is begins)
    assert taking.told.said == [(word, 1) for word in said]


def test_who_is_killed_is_told_to_die_and_loses_all_that_it_received():
    taking = Taking()
    taking.take(0, 0.0)
    assert taking.obey(CommandKind.KILL, 0.005) == (0,)
    (order,) = taking.told.orders
    assert order.orders.die
    assert (order.k, order.seen, np.frombuffer(order.x).tolist()) == (0, (1,), [*taking.x[3:6]])


def test_a_command_without_effect_tells_nobody_anything():
    taking = Taking()
    for kind in (CommandKind.THAW, CommandKind.RESTART):
        taking.obey(kind, 0.1)
    assert taking.told.said == []
    assert taking.schedule.tick(1) == 0.0
