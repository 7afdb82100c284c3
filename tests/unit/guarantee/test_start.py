"""Facts of a start: whether K_i is empty, and the time promised before a run."""

import re
from itertools import product
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import phalanx
from phalanx.guarantee import start
from phalanx.guarantee.certificate import highest_within
from phalanx.guarantee.certificates import SwarmCertificates, certified_for
from phalanx.guarantee.kept_distance import kept_distances
from phalanx.guarantee.radio_reach import radio_reach
from phalanx.guarantee.start import (
    Promise,
    certified_start,
    longest_certificate,
    promised,
    rows_at_start,
)
from phalanx.scenario.load import load, read_table
from phalanx.scenario.model import Scenario
from phalanx.swarm.points import agent_point
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.safety.function import Body, Separation
from tests.unit.swarms import checked, swarm_of_scenario

ATTACKS = sorted((Path(__file__).parents[3] / "scenarios" / "attacks").glob("*.toml"))


def ahead(name: str, **fields: object) -> Promise:
    return promised(build_swarm(load(name, {k.replace("__", "."): v for k, v in fields.items()})))


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(gap=st.floats(0.01, 8.0))
def test_two_agents_that_drive_at_each_other_meet_after_it(gap):
    """Each moves at 1 m/s: 1 m from one another after half the gap, and no sooner is promised."""
    promise = ahead("one-on-one", agents__1__start=[[0.0, -1.0 - gap]])
    assert 0.5 * gap - 2e-3 <= promise.time <= 0.5 * gap
    assert promise.pair == "1-2"


def head_on(*speeds: float) -> Scenario:
    """Normal agents at these speeds [m/s], each on its way to where the other starts."""
    table = read_table("one-on-one") | {"duration": 5.0}
    agent, track = table["agents"][0], {"type": "track", "gains": [2.0]}
    table["agents"] = [
        agent | {"names": [name], "start": [[x, 0.0]], "goal": [[-x, 0.0]], "law": track}
        for name, x in (("1", -3.0), ("2", 3.0))
    ]
    for group, speed in zip(table["agents"], speeds, strict=True):
        group["dynamics"] = agent["dynamics"] | {"speed": speed}
    pairs = {"composition": "pairs", "information": "split", "margin": "integrated", "eta": 0.0}
    table["safety"] |= {**pairs, "alpha": [5.0]}
    return load(table)


@pytest.mark.slow
def test_two_that_want_to_pass_one_another_stop_where_a_check_says():
    """The side that keeps more counts, whichever is declared first."""
    distances = {
        v: kept_distances(build_rows(build_swarm(head_on(*v)))) for v in product((1, 2), (1, 2))
    }
    run = phalanx.run(head_on(2, 2), engine="in-process")
    a, b = np.split(run.recording.x[-1], 2)
    assert distances[2, 2].distance == pytest.approx(np.linalg.norm(a - b), abs=1e-5)
    assert sum(distances[2, 2].terms.values()) == pytest.approx(distances[2, 2].distance - 1.0)
    assert distances[1, 2] == distances[2, 1]
    assert distances[1, 2].distance > 0.5 * (distances[1, 1].distance + distances[2, 2].distance)
    assert "0.062 by sampling period" in str(distances[2, 2])
    assert kept_distances(build_rows(swarm_of_scenario("unicycles"))) is None, "of one row for all"


def test_agents_too_far_apart_to_meet_are_promised_the_whole_run():
    assert ahead("one-on-one", agents__1__start=[[0.0, -50.0]]) == Promise(20.0, "")


def test_the_bound_of_a_kind_of_pair_is_built_once_for_all_times(monkeypatch):
    """Building takes most of the time: a second for each time tried, for crazyflies."""
    built = []

    def counted(*arguments):
        built.append(arguments)
        return highest_within(*arguments)

    monkeypatch.setattr(start, "highest_within", counted)
    assert ahead("one-on-one").time > 0.0
    assert len(built) == 1


def test_nothing_is_promised_from_an_unsafe_start():
    promise = ahead("one-on-one", agents__1__start=[[0.0, -0.9]])
    assert promise == Promise(0.0, "1-2", {"1-2": 0.0})
    assert str(promise).startswith("Nothing is promised ahead: no time is proven for 1-2")


def test_the_nearest_of_many_pairs_counts():
    starts = [[9.0, 0.0], [0.0, 2.0], [-9.0, 0.0], [0.0, -9.0]]
    promise = ahead("surrounded", agents__1__start=starts)
    assert promise.pair == "1-3"
    assert promise.time == promise.times["1-3"] == pytest.approx(0.5, abs=1e-3)
    assert promise.times == {"1-3": promise.time}


@pytest.mark.parametrize("file", ATTACKS, ids=[file.stem for file in ATTACKS])
def test_attacks_that_ship_violate_later_than_promised(file):
    (when,) = re.findall(r"unsafe from (\S+) s on", file.read_text(encoding="utf-8"))
    assert 0.0 < ahead(str(file)).time < float(when)


def test_a_promise_is_rounded_down_in_words():
    assert "Promised for the first 0.187 s: " in str(Promise(0.1879, "1-2"))


@pytest.mark.parametrize(("distance", "has_one"), [(1.1, False), (1.15, True)])
def test_one_row_of_all_pairs_has_an_input_if_its_worst_sum_is_not_positive(distance, has_one):
    """The adversary is as fast: 1 - d² + η is left, of η = 0.3."""
    start = {"agents.1.start": [[0.0, -distance]]}
    rows = build_rows(build_swarm(load("one-on-one", start)))
    assert rows_at_start(rows) == {"1": has_one}


def test_an_agent_that_sees_no_other_may_apply_any_input():
    far = {"agents.0.start": [[0.0, 0.0], [900.0, 0.0]], "agents.0.names": ["1", "3"]}
    alone = {**far, "safety.composition": "pairs", "safety.neighbourhood": 5.0}
    scenario = load("one-on-one", {**alone, "agents.1.start": [[0.0, 500.0]]})
    assert rows_at_start(build_rows(build_swarm(scenario))) == {"1": True, "3": True}


class Striped(Separation):
    """A function with an operation that has no interval rule."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return super().between(a, b) - 1e-9 * ca.fmod(a.p[0], 2.0)


def test_a_pair_that_no_input_can_certify_is_named_with_the_reason():
    striped = f'safety.function={{ type = "{__name__}:Striped", radius = 1.0 }}'
    certified = certified_start(swarm_of_scenario("one-on-one", striped))
    assert "no interval rule for the operation fmod" in certified.refused["1-2"]
    assert not certified.holds


def test_a_controller_asks_for_how_long_all_pairs_in_sight_are_certified():
    swarm, u = swarm_of_scenario("one-on-one", "agents.1.start=[[0.0, -1.02]]"), np.zeros(2)
    certificates, certified = SwarmCertificates(swarm).of(0), certified_for(swarm, 0)
    (time,) = certificates(swarm.start(), u)
    assert 0.0 < certified(swarm.start(), u, [0, 1]) == time < certificates.longest
    assert certified(swarm.start(), u, [0]) == certificates.longest


@pytest.mark.parametrize(("jitter", "holds"), [(0.0, False), (0.004, True)])
def test_a_start_has_to_be_certified_until_the_earliest_next_input(jitter, holds):
    """Agent 2 comes at 3 m/s, agent 1 flees at 1 m/s: they meet after about 8 ms; 3 is far."""
    chased = "agents.1.dynamics.speed=3.0", "agents.1.start=[[0.0, -1.016]]"
    two = 'agents.0.names=["1", "3"]', "agents.0.start=[[0.0, 0.0], [9.0, 0.0]]"
    swarm = swarm_of_scenario("one-on-one", *chased, *two, f"agents.0.clock.jitter={jitter}")
    assert 0.006 < longest_certificate(swarm, 0, swarm.start()) < 0.01
    assert certified_start(swarm).holds == holds


@pytest.mark.parametrize(("latency", "flees"), [(0.0, True), (0.004, False)])
def test_a_start_is_certified_by_fleeing_unless_zero_is_held_at_first(latency, flees):
    chased = "agents.1.start=[[0.0, -1.02]]", f"time.latency={latency}"
    swarm = swarm_of_scenario("one-on-one", *chased)
    (at_rest,) = SwarmCertificates(swarm).of(0)(swarm.start(), np.zeros(2))
    assert (longest_certificate(swarm, 0, swarm.start()) > at_rest) == flees


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
    pushed = {"agents.0.disturbance": {"bound": 0.5}, "agents.0.clock": {"period": 0.05}}
    tube = agent_point(build_swarm(load("radio", CALM | pushed)), 0).motion.tube
    assert tube > 0.0
    assert reach_of(**pushed).slack == pytest.approx(2.0 * (0.05 * 3.0 + tube))


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
