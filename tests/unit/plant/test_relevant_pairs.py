"""Functions along the world's history; of pairs left out none is relevant, wherever agents go."""

from collections.abc import Iterable

import numpy as np
import pytest
from phalanx_plant.world import evaluation
from phalanx_plant.world.evaluation import (
    EvaluatedSteps,
    Evaluation,
    LargestPsi,
    LogSumExp,
    PairValues,
    RelevantPairs,
)
from phalanx_plant.world.world import World

from phalanx.scenario.load import load
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.swarms import rows_of_scenario
from tests.unit.tables import group, swarm_table

LARGE = ("agents.0.count=28", "agents.1.count=4")


def both(rows: SafetyRows, monkeypatch: pytest.MonkeyPatch) -> tuple[RelevantPairs, RelevantPairs]:
    """One that searches for relevant pairs, and one that evaluates every pair."""
    functions = LargestPsi(rows).functions
    for limit in ("_FEW", "_FEW_ROWS"):
        monkeypatch.setattr(evaluation, limit, 0)
    looking = RelevantPairs(rows.swarm, functions)
    for limit in ("_FEW", "_FEW_ROWS"):
        monkeypatch.setattr(evaluation, limit, 1_000_000)
    return looking, RelevantPairs(rows.swarm, functions)


def at(pairs: RelevantPairs, swarm: Swarm, x: np.ndarray) -> PairValues:
    """Evaluate at states x, shape (s, n̄)."""
    return pairs(x, np.stack([swarm.positions(each) for each in x]))


@pytest.mark.parametrize("name", ["swarm", "swarm2d", "formation3d"])
def test_what_is_left_out_changes_no_digit_of_h_tot_nor_of_psi_nor_who_is_unsafe(name, monkeypatch):
    rows = rows_of_scenario(name, *(LARGE if name.startswith("swarm") else ()))
    swarm = rows.swarm
    looking, taking_all = both(rows, monkeypatch)
    total, largest_psi = LogSumExp(swarm.safety.rho, 10_000), LargestPsi(rows)
    walk = np.random.default_rng(0)
    x, fewest = swarm.start(), np.inf
    for step in range(150):
        # Now and then an agent is thrown far, as by a restart from another state.
        size = 3.0 if step % 50 == 49 else 0.05
        x = x + size * walk.standard_normal(x.shape)
        two = np.stack([x, x + 0.01])
        pairs, values, least = at(looking, swarm, two)
        every, of_all, _ = at(taking_all, swarm, two)
        assert sorted(every) == list(range(len(swarm.safe_set.pairs)))
        some, all_ = total(values[..., 0]), total(of_all[..., 0])
        assert (some.h_tot == all_.h_tot).all()
        assert (
            largest_psi(two, values, least, some) == largest_psi(two, of_all, least, all_)
        ).all()
        order = np.argsort(every)
        assert (values == of_all[:, order[pairs]]).all()
        assert (np.diff(order[pairs]) > 0).all(), "sums are in one order"
        left_out = np.ones(len(every), dtype=bool)
        left_out[order[pairs]] = False
        if left_out.any():
            assert (of_all[:, left_out, 0].max(axis=1) < least).all()
            assert (least <= np.minimum(0.0, values[..., 0].max(axis=1))).all()
        fewest = min(fewest, len(pairs))
    assert fewest < 0.5 * len(swarm.safe_set.pairs)


FAR_APART = 1000.0


def two_pairs_and_one_near_a_sphere() -> SafetyRows:
    """a and b, c and d, e and the sphere: all else is too far apart to count."""
    starts = line(7.07, 9.0, 9.0).reshape(5, 2).tolist()
    sphere = {"center": [2.0 * FAR_APART, 0.0], "clearance": 1.0}
    five = group("a b c d e", "normal", starts, "track-velocity", speed=1.0)
    return build_rows(build_swarm(load(swarm_table(five, safety={"eta": 0.0}, obstacles=[sphere]))))


def line(ab: float, cd: float, of_sphere: float) -> np.ndarray:
    """A stacked state by distances [m]; two that approach each go half the way."""
    x = np.zeros((5, 2))
    x[:, 0] = [-ab / 2, ab / 2, FAR_APART - cd / 2, FAR_APART + cd / 2, 2 * FAR_APART + of_sphere]
    return x.ravel()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # The largest h is that of a and b, about -49, and falls by less than is in reserve; the
        # others come from outside of the reach, about 7.9 m, but no agent goes farther than 1 m.
        ([(7.07, 9.69, 90.0)], [(7.2, 7.79, 90.0)]),
        ([(7.07, 90.0, 8.7)], [(7.2, 90.0, 7.79)]),
        # What has moved does so by little more than the slack, about 0.98 m.
        ([(7.07, 10.1, 90.0)], [(7.2, 7.79, 90.0)]),
        ([(7.07, 90.0, 8.9)], [(7.2, 90.0, 7.79)]),
        # Farther apart the slack is 2.5 m, and c and d use nearly all of it.
        ([(20.0, 25.0, 90.0)], [(20.0, 20.15, 90.0)]),
        # It falls by more, so that others count which were too far away.
        ([(7.07, 10.5, 90.0)], [(8.9, 8.7, 90.0)]),
        ([(7.07, 10.5, 90.0)], [(7.07, 10.5, 90.0), (8.9, 8.7, 90.0)]),
        # An agent goes far, seen at the second of two states only.
        ([(7.07, 90.0, 90.0)], [(7.07, 90.0, 90.0), (7.07, 5.0, 90.0)]),
    ],
    ids=[
        "two approach",
        "one approaches a sphere",
        "two move beyond the slack",
        "one moves beyond the slack",
        "a greater slack",
        "all are farther apart",
        "all are farther apart later",
        "a later state",
    ],
)
def test_agents_that_came_near_since_the_last_search_are_not_left_out(before, after, monkeypatch):
    rows = two_pairs_and_one_near_a_sphere()
    looking, taking_all = both(rows, monkeypatch)
    then, now = (np.stack([line(*distances) for distances in those]) for those in (before, after))
    assert len(at(looking, rows.swarm, then).pairs) < 3
    pairs, _, least = at(looking, rows.swarm, now)
    every, of_all, _ = at(taking_all, rows.swarm, now)
    counting = every[(of_all[..., 0] >= least[:, None]).any(axis=0)]
    assert len(counting) == 2
    assert set(counting) <= set(pairs)


@pytest.mark.parametrize(
    "function", ["Oval", "Reaches", "ShortSighted"], ids=["silent", "a field", "too short"]
)
def test_a_users_function_has_all_its_pairs_whatever_reach_it_returns(function, monkeypatch):
    radius = ", radius = 1.0" if function == "ShortSighted" else ""
    setting = f'safety.function={{ type = "tests.unit.theory.users_own:{function}"{radius} }}'
    rows = rows_of_scenario("swarm2d", *LARGE, setting)
    looking, _ = both(rows, monkeypatch)
    values = at(looking, rows.swarm, rows.swarm.start()[None])
    assert len(values.pairs) == len(rows.swarm.safe_set.pairs)


def test_pairs_are_numbered_as_the_safe_set_has_them(monkeypatch):
    rows = rows_of_scenario("formation3d")
    swarm = rows.swarm
    _, taking_all = both(rows, monkeypatch)
    which, values, _ = at(taking_all, swarm, swarm.start()[None])
    x = swarm.start().reshape(8, 6)[:, :3]
    for number, value in zip(which.tolist(), values[0, :, 0], strict=True):
        pair = swarm.safe_set.pairs[number]
        obstacle = pair.b >= 8 and swarm.scenario.obstacles[pair.b - 8]
        there = np.array(obstacle.center) if obstacle else x[pair.b]
        keep_out = obstacle.clearance if obstacle else 5.0
        assert value == pytest.approx(keep_out**2 - np.sum((x[pair.a] - there) ** 2))


@pytest.mark.parametrize("level", [0.0, -1.0, -50.0])
@pytest.mark.parametrize("obstacle", [Sphere((0.0, 0.0), 0.5), Wall((0.0, 2.0), 1.0, 0.5)])
def test_beyond_its_reach_an_obstacles_intrusion_is_below_the_level(obstacle, level):
    points = np.random.default_rng(1).uniform(-70.0, 70.0, (800, 2))
    beyond = obstacle.distances(points) > obstacle.reach(level)
    h = np.array([float(obstacle.intrusion(p)) for p in points])
    assert beyond.any()
    assert (h[beyond] < level).all()
    assert (h[~beyond] >= level - 1e-6).all()


def test_pairs_that_do_not_count_hide_none_that_does(monkeypatch):
    """a and b, two turned agents, collide; the largest h that counts is of c and d, far below."""
    rows = two_pairs_and_one_near_a_sphere()
    looking, _ = both(rows, monkeypatch)
    swarm, states = rows.swarm, np.stack([line(0.1, 11.0, 90.0)])
    labels = [swarm.safe_set.label(pair) for pair in swarm.safe_set.pairs]
    assert {labels[k] for k in at(looking, swarm, states).pairs} == {"a-b"}
    looking.excluded[labels.index("a-b")] = True
    values = at(looking, swarm, states)
    assert {"a-b", "c-d"} <= {labels[k] for k in values.pairs}
    assert values.least[0] <= 1.0 - 11.0**2


def figures(steps: Iterable[EvaluatedSteps], number: int = 0) -> np.ndarray:
    """Time, h_tot and the largest ψ of every step of a history, whatever was left out of h."""
    columns = [
        np.stack([s.times, s.h_tot, *([s.psi] if len(s.psi) else [])])[:, s.numbers == number]
        for s in steps
    ]
    return np.concatenate(columns, axis=1)


@pytest.mark.parametrize("name", ["unicycles", "formation3d", "swarm"])
def test_several_histories_at_once_give_the_values_of_each_alone(name):
    rows = rows_of_scenario(name, *(LARGE if name == "swarm" else ()))
    world, histories = World(rows), []
    for stop in (0.003, 0.01, 0.07, 0.0701, 0.62):
        world.advance(stop)
        histories.append(world.take_history())
    together, alone = list(Evaluation(rows).of(histories)), Evaluation(rows)
    for number, history in enumerate(histories):
        values, expected = figures(together, number), figures(alone.of([history]))
        assert values.shape == expected.shape
        assert (values == expected).all()


def test_no_history_has_no_values():
    rows = rows_of_scenario("unicycles")
    assert list(Evaluation(rows).of([])) == []
    assert list(Evaluation(rows).of([[], []])) == []
