"""A control step beside its controller: what it accepts, and how it joins a run that goes on."""

import pytest

from phalanx.agent.step import ControlStep
from phalanx.wire.messages import Broadcast, Sample
from phalanx.wire.seal import Malformed
from tests.unit.swarms import rows_of_scenario

PERIOD = 0.01


@pytest.fixture
def step() -> ControlStep:
    """Agent 1's of Simulation 1."""
    return ControlStep(rows_of_scenario("unicycles"), 0)


def sample(step: ControlStep, k: int, latest: int) -> Sample:
    """The swarm where it starts, every other agent having sent broadcasts up to `latest`."""
    x = step.swarm.start().astype("<f8").tobytes()
    return Sample(k=k, t=PERIOD * k, x=x, latest=(latest,) * len(step.swarm.members))


def hear(step: ControlStep, k: int) -> None:
    """Broadcast k of every agent that this one listens to arrives."""
    for name in step.listens_to:
        step.accept_broadcast(name, Broadcast(k=k, t_apply=PERIOD * k, u=(1.0, 0.0)))


@pytest.mark.parametrize("k", [0, 1, 37])
def test_whoever_takes_over_from_a_dead_agent_joins_at_any_sample(step: ControlStep, k: int):
    first = step.accept_sample(sample(step, k, latest=k - 1))
    assert not step.inbox.missing(first.latest), "it waits for what was sent before its time"
    answer = step(first)
    assert answer.actuation.k == answer.broadcast.k == answer.telemetry.k == k
    assert set(answer.telemetry.ages) == {None}, "it knows nobody's input yet"
    hear(step, k)
    second = step.accept_sample(sample(step, k + 1, latest=k))
    assert not step.inbox.missing(second.latest)
    ages = step(second).telemetry.ages
    assert [age for age in ages if age is not None] == pytest.approx([PERIOD, PERIOD])


def test_a_broadcast_from_before_its_time_is_refused(step: ControlStep):
    step.accept_sample(sample(step, 5, latest=4))
    with pytest.raises(Malformed, match="out of order"):
        hear(step, 4)


@pytest.mark.parametrize("k", [5, 4, 7, -1])
def test_after_the_first_every_sample_is_the_next(step: ControlStep, k: int):
    step.accept_sample(sample(step, 5, latest=4))
    with pytest.raises(Malformed, match="out of order"):
        step.accept_sample(sample(step, k, latest=4))


def test_what_peers_hear_is_the_input_and_nothing_of_how_it_was_made(step: ControlStep):
    answer = step(step.accept_sample(sample(step, 0, latest=-1)))
    assert answer.broadcast.__struct_fields__ == ("version", "k", "t_apply", "u")
    assert answer.broadcast.u == answer.actuation.u
