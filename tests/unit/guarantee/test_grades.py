"""Promises of a check, pair by pair, and what it says is short of one."""

import re

import numpy as np
import pytest

from phalanx.guarantee.check import check
from phalanx.guarantee.impossible import impossible
from phalanx.guarantee.promise import Grades, _gaps, grades
from phalanx.promise.capsules import balls
from phalanx.swarm.swarm import build_swarm
from tests.unit.promise.test_runs import scenario
from tests.unit.swarms import checked, swarm_of_scenario


@pytest.mark.parametrize(("count", "more"), [(2, ""), (6, ""), (8, "; 2 more")])
def test_of_many_pairs_six_are_named(count, more):
    short = {f"a-{k}": "too near" for k in range(count)}
    pairs = "; ".join(f"a-{k}: too near" for k in range(min(count, 6)))
    promised = "Promised before the run, under any filter and network"
    assert Grades(("b-c",), short=short).sentences(True, {}) == [
        f"{promised}: b-c for ever.",
        f"Not promised: {pairs}{more}.",
    ]


def test_of_refusals_only_a_bound_that_is_too_large_is_said():
    def sentences(*refusals: str) -> list[str]:
        return Grades(refusals=refusals).sentences(False, {})

    short = "disturbance.bound of a: too large"
    would = f"safety.keep = 'hold' could promise nothing: {short}."
    assert sentences("limits: expected none", short) == [would]
    assert sentences("limits: expected none") == []


def test_tubes_of_several_parts_are_as_near_as_their_nearest():
    def at(*x: float):
        return balls(np.array([[place, 0.0] for place in x]), np.full(len(x), 0.25))

    gaps = _gaps(at(0.0, 1.0), {2: at(3.0, 2.0), 5: at(4.0), 6: at(9.0, 7.0)})
    assert gaps == pytest.approx({2: 0.5, 5: 2.5, 6: 5.5}, abs=1e-5)


def words(**changes) -> str:
    return " ".join(check(scenario(**changes)).words)


@pytest.mark.slow
def test_check_grades_each_pair():
    graded = grades(build_swarm(scenario()))
    assert graded.for_ever == ("a-b", "a-obstacle 0", "b-obstacle 0")
    assert graded.passively == ("a-rogue", "b-rogue")
    sentences = words()
    assert "Promised before the run, under any filter and network: a-b, a-obstacle 0" in sentences
    assert "a-rogue, b-rogue passively" in sentences
    without = words(safety__keep=None)
    assert "With safety.keep = 'hold': promised" in without
    assert ("moves by itself" in sentences, "moves by itself" in without) == (True, False)


@pytest.mark.slow
def test_check_names_what_is_short_and_what_would_do():
    near = {"agents__0__start": [[-0.5, 0.0], [0.5001, 0.0]]}
    assert re.search(
        r"Not promised: a-b: 0\.0\S+ m nearer than it may start, safe for 0\.\d{3} s", words(**near)
    )
    graded = grades(build_swarm(scenario(**near)))
    assert "a-b" not in graded.for_ever
    short = float(graded.short["a-b"].split(" m")[0])
    larger = 0.5001 + short + 1e-3
    enough = scenario(agents__0__start=[[-0.5, 0.0], [larger, 0.0]])
    assert "a-b" in grades(build_swarm(enough)).for_ever
    too_much = grades(build_swarm(scenario(agents__0__disturbance__bound=1.5)))
    (why,) = {
        text.split(" of ", 1)[0] + text.split(" holds", 1)[-1] for text in too_much.refusals[:1]
    }
    assert "disturbance.bound" in why
    bound = float(too_much.refusals[0].split("at most ")[1].split(" would do")[0])
    assert grades(build_swarm(scenario(agents__0__disturbance__bound=0.99 * bound))).for_ever
    assert not grades(build_swarm(scenario(agents__0__disturbance__bound=1.01 * bound))).for_ever


@pytest.mark.slow
def test_check_says_at_what_disturbance_of_both_a_robot_outruns_its_pursuer():
    def leaving(bound: float) -> str:
        return impossible(swarm_of_scenario("unicycles", *(
            f"agents.{g}.disturbance.bound={bound}" for g in (0, 1)
        ))).exit  # fmt: skip

    assert "4 makes 3.8 m/s with its disturbance, 1 2.22 m/s straight on" in leaving(1.73)
    bound = float(leaving(1.73).split("at most ")[1].split(" for both")[0])
    assert bound == pytest.approx(0.9625, abs=1e-3)
    assert leaving(1.01 * bound)
    assert not leaving(0.99 * bound)
    assert "Impossible by exit: 4 makes 3.8 m/s" in " ".join(checked("unicycles").words)
