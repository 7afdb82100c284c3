"""Deadlock: who wants to move and stands, on positions and inputs that are made by hand."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

import phalanx
from phalanx.guarantee.verdict import Deadlock, waiting_in_words
from phalanx.recording.columns import Inputs, States, indices, inputs_of
from phalanx.recording.deadlock import DeadlockWatch, Wishes
from phalanx.recording.metrics.measures import Thresholds, deadlocks_of
from phalanx.recording.read import swarm_of
from phalanx.recording.records import Step
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from tests.unit.tables import SPLIT, group, swarm_table

OF_ALL = {"law": {"type": "track-velocity", "gain": 1.0}, "clock": {"period": 0.25, "jitter": 0.05}}
TABLE = swarm_table(
    group("a b", "normal", [[0.0, 0.0], [0.0, 2.0]], goal=[[9.0, 0.0], [9.0, 9.0]], **OF_ALL),
    group("z", "adversary", [[90.0, 0.0]], goal=[[90.0, 9.0]], **OF_ALL),
    function="distance",
    radius=0.5,
    safety=SPLIT | {"rho": 20.0},
    duration=25.0,
    obstacles=[{"center": [0.0, 40.0], "clearance": 1.0}],
)


@pytest.fixture(scope="module")
def swarm() -> Swarm:
    return build_swarm(load(TABLE))


def step(
    t: float, wish: tuple[float, float] = (1.0, 0.0), u: tuple[float, float] = (0.0, 0.0),
    binding: tuple[int, ...] = (), agent: str = "a",
) -> Step:  # fmt: skip
    return Step(
        agent=agent, k=0, t=t, t_apply=t, u=u, u_nom=wish, origin=Origin.QP, residual=0.0,
        solve_time=0.0, ages=[], fates=[], binding=binding,
    )  # fmt: skip


NOWHERE = np.zeros(6)


class Watched(DeadlockWatch):
    """A watch that sees events one by one."""

    number = 0

    def see(self, *steps: Step, at: float | None = None, x: Array = NOWHERE) -> list[str]:
        """Let inputs of agent a take effect, or a state be reached; return new deadlocks."""
        self.number += 1
        t = [] if at is None else [at]
        states = States(indices([self.number] * len(t)), np.array(t), np.tile(x, (len(t), 1)))
        return [text for _, text in self.add(states, inputs(steps, self.number))]


def inputs(steps: Sequence[Step], number: int = 0) -> Inputs:
    events = [(number + n, 0, s.k, s.t, s.t_apply, False) for n, s in enumerate(steps)]
    return inputs_of(events, [s.u for s in steps], steps, np.full(3, 2))


def line(t: np.ndarray, stop: float = np.inf) -> np.ndarray:
    """Return positions of an agent that moves along x at 1 m/s and stands from `stop` on."""
    return np.column_stack([np.minimum(t, stop), np.zeros_like(t)])


def deadlocks(
    swarm: Swarm, t: np.ndarray, p: np.ndarray, goal: tuple[float, float], gap: float = 2.0,
    patience: float = 5.0, binding: Mapping[int, tuple[int, ...]] = {},
) -> list[Deadlock]:  # fmt: skip
    """Watch an agent that wants to move while it is not at its goal, and another near it."""
    watch = Watched(swarm, 0.25, patience)
    for k, (at, point) in enumerate(zip(t.tolist(), p, strict=True)):
        other = [point[0], point[1] + (gap if np.isscalar(gap) else gap[k])]
        new = watch.see(at=at, x=np.concatenate([point, other, [90.0, 0.0]]))
        assert [text[:7] for text in new] in ([], ["agent a"])
        away = float(np.linalg.norm(point - goal)) > 0.5
        watch.see(step(at, (float(away), 0.0), binding=binding.get(int(at), (1,))))
    return watch.deadlocks


def seconds(*arguments) -> float:
    return sum(d.end - d.begin for d in deadlocks(*arguments))


def test_an_agent_that_stands_away_from_its_goal_is_in_deadlock(swarm):
    t = np.linspace(0.0, 20.0, 401)
    # It stands from t = 8 s on; within 0.25 m of that place it is from t = 7.75 s on.
    (deadlock,) = deadlocks(swarm, t, line(t, stop=8.0), (15.0, 0.0))
    assert (deadlock.agent, deadlock.waits_for) == ("a", ["b"])
    assert deadlock.begin == pytest.approx(7.75, abs=0.15)
    assert deadlock.end == pytest.approx(20.0, abs=0.11)
    assert deadlock.held_by["b"] == pytest.approx(deadlock.end - deadlock.begin)


def test_an_agent_that_stands_at_its_goal_moves_or_waits_briefly_is_not(swarm):
    t = np.linspace(0.0, 20.0, 401)
    assert deadlocks(swarm, t, line(t, stop=8.0), (8.3, 0.0)) == []
    assert deadlocks(swarm, t, line(t), (50.0, 0.0)) == []
    brief = np.column_stack([np.where(t < 8.0, t, np.maximum(8.0, t - 4.0)), 0.0 * t])
    assert deadlocks(swarm, t, brief, (50.0, 0.0)) == []
    short = np.linspace(0.0, 4.9, 99)
    assert deadlocks(swarm, short, line(short, stop=0.0), (50.0, 0.0)) == []


def test_trembling_in_place_is_deadlock_and_circling_is_not(swarm):
    t = np.linspace(0.0, 20.0, 401)
    around = np.column_stack([np.cos(t * 2.5), np.sin(t * 2.5)])
    assert seconds(swarm, t, 0.1 * around, (5.0, 0.0)) == pytest.approx(20.0, abs=0.2)
    assert deadlocks(swarm, t, 1.0 * around, (5.0, 0.0)) == []


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.01, 0.11, 0.3])
def test_deadlock_does_not_depend_on_how_often_states_are_recorded(swarm, step):
    t = np.arange(0.0, 20.0, step)
    assert seconds(swarm, t, line(t, stop=8.0), (15.0, 0.0)) == pytest.approx(12.25, abs=0.9)


def test_one_that_others_pass_is_not_in_deadlock(swarm):
    t = np.linspace(0.0, 20.0, 401)
    passing = 2.0 + np.abs(t % 4.0 - 2.0)
    assert deadlocks(swarm, t, np.zeros((401, 2)), (9.0, 0.0), passing) == []


def test_others_that_pass_behind_an_obstacle_next_to_it_are_no_way_out(swarm):
    t = np.linspace(0.0, 20.0, 401)
    passing = 2.0 + np.abs(t % 4.0 - 2.0)
    beside = np.tile([0.0, 38.5], (401, 1))  # 0.5 m from the obstacle
    assert len(deadlocks(swarm, t, beside, (9.0, 38.5), passing)) == 1


@pytest.mark.parametrize("share", [0.4, 0.6])
def test_one_is_in_deadlock_if_it_wants_to_move_most_of_the_time(swarm, share):
    watch = Watched(swarm, 0.25, 5.0)
    for t in np.arange(0.0, 20.0, 0.05).tolist():
        watch.see(at=t, x=np.array([0.0, 0.0, 0.0, 2.0, 90.0, 0.0]))
        watch.see(step(t, (float(t % 1.0 < share), 0.0), binding=(1,)))
    assert bool(watch.deadlocks) == (share > 0.5)


def test_one_that_moves_on_and_stands_again_is_in_deadlock_twice(swarm):
    t = np.linspace(0.0, 24.0, 481)
    stop = np.where(t < 8.0, 0.0, np.where(t < 10.0, t - 8.0, 2.0))
    first, second = deadlocks(swarm, t, np.column_stack([stop, 0.0 * t]), (9.0, 0.0))
    assert (first.begin, first.end) == (0.0, pytest.approx(8.2, abs=0.2))
    assert second.begin == pytest.approx(9.8, abs=0.2)


def test_who_holds_it_is_whose_row_binds_and_not_who_is_nearest(swarm):
    t = np.linspace(0.0, 20.0, 401)
    still = np.zeros((401, 2))
    # Member 1 is near; the adversary, and obstacle 0, whose number is 3, hold it, now and then.
    often = dict.fromkeys(range(0, 20, 2), (2, 3))
    rows = often | dict.fromkeys(range(1, 20, 2), (2,))
    (deadlock,) = deadlocks(swarm, t, still, (9.0, 0.0), binding=rows)
    label = swarm.safe_set.labels[3]
    assert deadlock.held_by[label] == pytest.approx(0.5 * deadlock.held_by["z"], abs=0.6)
    assert "b" not in deadlock.held_by
    # No index that an agent may state is one of nothing.
    (deadlock,) = deadlocks(swarm, t, still, (9.0, 0.0), binding=dict.fromkeys(range(21), (-1, 99)))
    assert (deadlock.held_by, str(deadlock)[-22:]) == ({}, "held by: no row of its own"[-22:])


@pytest.mark.parametrize(
    ("wish", "u", "held"),
    [
        ((1.0, 0.0), (0.0, 0.0), True),
        ((1.0, 0.0), (1.0, 0.0), False),  # it does what it wants
        ((9.0, 0.0), (2.0, 0.0), False),  # as fast as its actuators allow
        ((9.0, 0.0), (0.5, 0.0), True),
        ((0.1, 0.0), (0.0, 0.0), False),  # it hardly wants to move
        ((), (0.0, 0.0), False),  # its wish is not known
    ],
)
def test_a_wish_is_held_if_it_is_one_to_move_and_the_input_another(swarm, wish, u, held):
    columns, watch = inputs([step(1.0, wish, u, (1,))]), Watched(swarm)
    assert Wishes(swarm).held(columns.i, columns.u, columns.u_nom).tolist() == [held]
    watch.see(step(1.0, wish, u, (1,)))
    assert watch.held_for(1.25).tolist() == [0.25 * held, 0.0, 0.0]


def test_one_that_died_wants_nothing_though_its_actuator_holds_its_last_input(swarm):
    watch = Watched(swarm)
    watch.see(*[step(0.25 * k) for k in range(5)])
    assert watch.held_for(1.2)[0] == pytest.approx(1.2)
    assert watch.held_for(50.0)[0] == pytest.approx(1.6)


def test_words_name_the_longest_wait_of_each_and_no_more_than_so_many():
    short, long = Deadlock("a", 1.0, 4.0, {"c": 3.0}), Deadlock("a", 8.0, 20.0, {"c": 9, "d": 12})
    others = [Deadlock(f"r{n}", 2.0, 5.0, {"a": 1.0}) for n in range(3)]
    words = waiting_in_words([short, *others, long], most=3)
    assert words.startswith("a for c and d (8 to 20 s), r0 for a (2 to 5 s), r1 for a")
    assert words.endswith(", 1 more")
    assert waiting_in_words([]) == ""


@pytest.mark.slow
def test_a_run_records_its_deadlocks_and_a_second_look_sees_the_same(tmp_path):
    facing = {**TABLE, "agents": [{**TABLE["agents"][0], "start": [[-4.0, 0.0], [4.0, 0.0]],
              "goal": [[4.0, 0.0], [-4.0, 0.0]]}]}  # fmt: skip
    run = phalanx.run(facing, engine="in-process", out=tmp_path)
    recorded = run.summary.deadlocks
    assert recorded is not None
    assert [(d.agent, d.waits_for) for d in recorded] == [("a", ["b"]), ("b", ["a"])]
    lines = [line for line in run.recording.log if "has stood since" in line.text]
    assert [line.text for line in lines] == [str(deadlock) for deadlock in recorded]
    for line, deadlock in zip(lines, recorded, strict=True):
        assert line.t == pytest.approx(deadlock.begin + 5.0, abs=0.5)  # once it is established
    assert run.judge_again().deadlocks == recorded
    swarm = swarm_of(run.recording)
    assert deadlocks_of(run.recording, swarm) is run.recording.summary.deadlocks
    assert deadlocks_of(run.recording, swarm, Thresholds(patience=5.0)) == recorded
    assert deadlocks_of(run.recording, swarm, Thresholds(patience=24.0)) == []
    run.recording.summary.deadlocks = None  # as of an older program
    assert deadlocks_of(run.recording, swarm) == recorded
