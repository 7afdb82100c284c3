"""Links on board: lost samples, late and lost inputs, and the schedule that follows."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from phalanx_plant.sampling.sampling import OnboardLinks, Schedule
from phalanx_plant.world.events import SwarmBrokenError

from phalanx.network.rule import Message, Treatment
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import Swarm, build_swarm

END = 4.0


def swarm_with(**network: Any) -> Swarm:
    return build_swarm(load("unicycles", {"duration": END, "network": network}))


def course(
    swarm: Swarm, end: float = END
) -> tuple[OnboardLinks, dict[int, list[float]], list[Any]]:
    """The links, each agent's sampling times, and each input: (agent, k, due, takes effect)."""
    latency = swarm.time.latency
    links = OnboardLinks(swarm)
    schedule = Schedule([swarm.clock(i) for i in range(len(swarm.names))], latency, links)
    samples: dict[int, list[float]] = {i: [] for i in range(len(swarm.names))}
    inputs, newest = [], {}
    while (t := schedule.next_event()) < end:
        for i in schedule.sampling_at(t):
            newest[i] = schedule.sampled(i, t)
            samples[i].append(t)
        for i in schedule.take_applying(t):
            inputs.append((i, newest[i], t, not schedule.loses_input(i)))
    return links, samples, inputs


def test_a_lost_sample_is_missed_and_the_clock_goes_on_as_it_would_have():
    _, whole, _ = course(swarm_with())
    links, with_losses, inputs = course(swarm_with(sample={"loss": 0.3}))
    count = sum(map(len, whole.values()))
    for i, times in with_losses.items():
        assert set(times) < set(whole[i])
        assert [k for j, k, *_ in inputs if j == i] == list(range(len(times)))
    missed = count - sum(map(len, with_losses.values()))
    assert links.faults == {0: missed}
    assert missed / count == pytest.approx(0.3, abs=4.0 * np.sqrt(0.21 / count))


@dataclass(frozen=True)
class Refuses:
    """A rule with a mistake in it."""

    def treat(self, message: Message) -> Treatment:
        raise ZeroDivisionError("by the rule")


@pytest.mark.parametrize("link", ["sample", "actuation"])
def test_a_rule_on_board_that_fails_ends_the_run_in_words(link: str):
    swarm = swarm_with(**{link: {"rules": [{"type": f"{__name__}:Refuses"}]}})
    with pytest.raises(SwarmBrokenError, match=r"own link: rule .*Refuses.* by the rule"):
        course(swarm)


def test_without_faults_all_agents_sample_whenever_their_clocks_tick():
    swarm = swarm_with()
    _, samples, _ = course(swarm)
    for i, times in samples.items():
        clock, tick = swarm.clock(i), 0.0
        for k, t in enumerate(times):
            assert t == tick
            tick = clock.after(k, tick)


def test_samples_that_all_are_lost_end_with_the_run():
    links, samples, inputs = course(swarm_with(sample={"loss": 1.0}))
    assert not any(samples.values())
    assert not inputs
    assert links.faults[0] > 0


def test_a_late_input_takes_effect_late():
    swarm = swarm_with(actuation={"delay": 0.004})
    _, samples, inputs = course(swarm)
    assert all(takes for *_, takes in inputs)
    for i, k, t, _ in inputs:
        assert t == samples[i][k] + 0.004


def test_an_input_that_comes_after_the_next_sample_is_never_applied():
    latest = 0.03
    swarm = swarm_with(actuation={"delay": {"low": 0.0, "high": latest}})
    _, samples, inputs = course(swarm)
    applied = [(i, k, t) for i, k, t, takes in inputs if takes]
    assert 0 < len(applied) < len(inputs)
    for i, k, t in applied:
        assert k + 1 >= len(samples[i]) or t < samples[i][k + 1]
    # Delays are uniform: as many come in time as the gap is of the longest.
    gap = np.mean([np.mean(np.diff(times)) for times in samples.values()])
    assert gap < latest
    assert len(applied) / len(inputs) == pytest.approx(gap / latest, abs=0.05)


def test_an_input_that_comes_at_the_very_instant_of_the_next_sample_is_never_applied():
    period = 2.0**-7
    clock = {f"agents.{group}.clock": {"period": period} for group in (0, 1)}
    late = {"network.actuation": {"delay": period}}
    _, samples, inputs = course(build_swarm(load("unicycles", {"duration": END, **clock, **late})))
    assert samples[0][:3] == [0.0, period, 2.0 * period]
    assert inputs
    assert not any(takes for *_, takes in inputs)


def test_a_lost_input_is_lost_and_the_others_are_not_late():
    links, samples, inputs = course(swarm_with(actuation={"loss": {"mean": 0.2, "burst": 3.0}}))
    lost = [takes for *_, takes in inputs].count(False)
    assert links.faults == {0: lost}
    assert lost / len(inputs) == pytest.approx(0.2, abs=0.06)
    assert all(t == samples[i][k] for i, k, t, _ in inputs)


def test_one_robots_links_do_not_affect_another_robot():
    faulty = [{"of": "sample", "to": "2", "loss": 0.5}]
    _, whole, _ = course(swarm_with())
    _, with_losses, _ = course(swarm_with(links=faulty))
    assert {i for i in whole if whole[i] != with_losses[i]} == {1}


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"network.sample": {"delay": 0.1}}, "network.sample.delay: expected loss and corrupt"),
        (
            {"network.links": [{"of": "sample", "rate": {"bits_per_second": 1e3}}]},
            "network.links.0.rate: expected loss and corrupt alone",
        ),
        (
            {"faults": [{"kind": "hold", "of": "sample", "for": 1.0}]},
            "faults.0.of: expected broadcast or actuation",
        ),
    ],
)
def test_samples_are_not_late(overrides, message):
    with pytest.raises(ScenarioError, match=message.replace(".", r"\.")):
        load("unicycles", overrides)


def test_an_agent_that_continues_samples_at_once_but_not_before_its_last_input_has_taken_effect():
    swarm = swarm_with()
    schedule = Schedule([swarm.clock(0)], 0.004, OnboardLinks(swarm))
    schedule.sampled(0, 0.0)
    for t, goes_on in ((0.002, np.nextafter(0.004, 1.0)), (0.5, 0.5)):
        schedule.silence(0)
        assert schedule.tick(0) == np.inf
        schedule.resume(0, t)
        assert schedule.tick(0) == goes_on
