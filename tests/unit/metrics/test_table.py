"""The metrics of recordings whose trajectories are computed by hand, and metrics of one's own."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import phalanx
from phalanx.recording.metrics.measures import (
    InputSeries,
    arrival_time,
    input_deviation,
    input_energy,
    mean_over_time,
)
from phalanx.recording.metrics.table import METRICS, SWARM, in_words, metric_rows, metrics_of
from phalanx.recording.read import Recording, swarm_of
from phalanx.recording.records import State, Step
from phalanx.scenario.load import load
from phalanx.theory.rows.origin import Origin
from tests.unit.tables import SPLIT, group, swarm_table

TABLE = swarm_table(
    group("a b", "normal", [[0.0, 0.0], [0.0, -3.0]], period=0.1),
    group("c", "adversary", [[0.0, -4.0]], "pursue", speed=1.0, period=0.1),
    function="distance",
    radius=0.5,
    safety=SPLIT,
    name="by-hand",
    duration=10.0,
    obstacles=[{"center": [0.0, 5.0], "clearance": 2.0}],
)
ALONG_X = {"type": "path", "points": [[0.0, 0.0], [10.0, 0.0]], "speed": 1.0}
REST = [0.0, -3.0]


def recording_of(
    goal: list[object] | None = None, a_speed: float = 1.0, steps: list[Step] | None = None
) -> Recording:
    """Return a recording of ten seconds: a moves along x, b and c stand."""
    overrides = {"agents.0.goal": goal} if goal else {}
    states = [
        State(float(t), [a_speed * float(t), 0.0, 0.0, -3.0, 0.0, -4.0], -1.0)
        for t in np.linspace(0.0, 10.0, 101)
    ]
    return Recording(Path("none"), load(TABLE, overrides), {"run": "r"}, states, steps or [])


def step(agent: str, k: int, t: float, u: float, origin: Origin = Origin.QP) -> Step:
    return Step(
        agent=agent, k=k, t=t, t_apply=t, u=(u, 0.0), u_nom=(1.0, 0.0), origin=origin,
        residual=0.0, solve_time=0.0, ages=[], fates=[],
    )  # fmt: skip


def figures(recording: Recording) -> dict[str, dict[str, object]]:
    return metrics_of(recording, swarm_of(recording))


def test_an_agent_on_its_goal_has_no_error_and_arrives():
    a = figures(recording_of([ALONG_X, REST]))["a"]
    assert a["tracking_error_mean"] == pytest.approx(0.0, abs=1e-12)
    assert a["distance_to_goal"] == pytest.approx(0.0)
    assert a["arrived"] is True
    assert a["arrival_time"] == pytest.approx(9.5)


def test_an_agent_at_half_its_goals_speed_lags_and_does_not_arrive():
    metrics = figures(recording_of([ALONG_X, REST], a_speed=0.5))
    assert metrics["a"]["tracking_error_mean"] == pytest.approx(2.5)
    assert metrics["a"]["tracking_error_final"] == pytest.approx(5.0)
    assert metrics["a"]["arrived"] is False
    assert metrics["a"]["arrival_time"] is None
    assert metrics[SWARM]["tracking_error_mean"] == pytest.approx(1.25)
    assert metrics[SWARM]["tracking_error_final"] == pytest.approx(5.0)
    assert metrics[SWARM]["arrived"] is False
    assert metrics[SWARM]["arrival_time"] is None


def test_waypoints_are_passed_by_the_true_states():
    way = {"type": "waypoints", "points": [[3.0, 0.0], [10.0, 0.0]], "tolerance": 1.0}
    a = figures(recording_of([way, REST]))["a"]
    t = np.linspace(0.0, 10.0, 101)
    error = np.where(t < 2.0, 3.0 - t, 10.0 - t)  # at t = 2 s it is a metre from the first
    assert a["tracking_error_mean"] == pytest.approx(np.trapezoid(error, t) / 10.0)
    assert a["arrived"] is True


def test_agents_that_stand_though_they_want_to_move_are_in_deadlock():
    still = [step(agent, k, 0.1 * k, 0.0) for k in range(100) for agent in "ab"]
    metrics = figures(recording_of([ALONG_X, [4.0, 0.0]], steps=still))
    assert metrics["a"]["deadlock_time"] == 0.0
    assert metrics["b"]["deadlock_time"] == pytest.approx(10.0, abs=0.2)
    assert metrics[SWARM]["deadlock_time"] == metrics["b"]["deadlock_time"]
    assert metrics[SWARM]["deadlock_since"] == 0.0


def test_agents_without_goal_have_no_metrics_of_one():
    metrics = figures(recording_of())
    goals = list(METRICS)[:5]
    assert [[agent[name] for name in goals] for agent in metrics.values()] == [[None] * 5] * 4
    assert in_words(metrics, ["a", "b"]) == ""


def test_a_goal_that_never_rests_is_not_arrived_at():
    circle = {"type": "tests.unit.swarm.test_goals:Circle", "kind": "right"}
    a = figures(recording_of([circle, REST]))["a"]
    assert (a["distance_to_goal"], a["arrived"], a["arrival_time"]) == (None, None, None)


def test_least_distances_are_to_any_other_and_to_obstacles_less_their_clearance():
    metrics = figures(recording_of())
    assert metrics["a"]["least_distance"] == pytest.approx(3.0)
    assert metrics["b"]["least_distance"] == pytest.approx(1.0)
    assert metrics["a"]["least_clearance"] == pytest.approx(5.0 - 2.0)
    assert metrics[SWARM]["least_distance"] == pytest.approx(1.0)


def test_an_input_counts_until_the_next_one_or_the_end():
    steps = [
        step("a", 0, 1.0, 2.0),
        step("a", 1, 4.0, 1.0, Origin.BACKUP),
        step("a", 2, 9.0, 3.0, Origin.NO_AUTHORITY),
        step("a", 3, 10.5, 9.0),
    ]
    metrics = figures(recording_of(steps=steps))
    a = metrics["a"]
    assert a["input_energy"] == pytest.approx(3.0 * 4.0 + 5.0 * 1.0 + 1.0 * 9.0)
    assert a["input_deviation_mean"] == pytest.approx((3.0 * 1.0 + 5.0 * 0.0 + 1.0 * 2.0) / 9.0)
    assert a["backup_time"] == pytest.approx(5.0)
    assert a["no_authority_time"] == pytest.approx(1.0)
    assert metrics["b"]["input_energy"] is None


def test_a_recording_without_a_state_has_no_metrics():
    empty = recording_of([ALONG_X, REST])
    empty.states.clear()
    assert {value for agent in figures(empty).values() for value in agent.values()} == {None}


def test_the_table_has_a_row_for_each_agent_and_the_swarm():
    table = phalanx.metrics.of(SimpleNamespace(recording=recording_of([ALONG_X, REST])))
    assert table.columns == ["run", "scenario", "seed", "agent", "role", *METRICS]
    assert table["agent"].to_list() == ["a", "b", "c", SWARM]
    assert table["role"].to_list() == ["normal", "normal", "adversary", SWARM]
    assert table["arrived"].to_list() == [True, True, None, True]


def test_limits_may_be_given():
    run = SimpleNamespace(recording=recording_of([ALONG_X, [0.0, -2.0]]))
    near, far = (
        phalanx.metrics.of(run, phalanx.metrics.Thresholds(arrival=radius))["arrived"].to_list()
        for radius in (0.9, 1.1)
    )
    assert (near[1], far[1]) == (False, True)


def test_a_metric_of_ones_own_is_a_function_of_the_run():
    run = SimpleNamespace(recording=recording_of())
    table = phalanx.metrics.of(
        run,
        states=lambda run: len(run.recording.states),
        furthest=lambda run: {"a": run.recording.x[:, 0].max()},
    )
    assert table["states"].to_list() == [None, None, None, 101.0]
    assert table["furthest"].to_list() == [10.0, None, None, None]


@pytest.mark.parametrize(
    ("metric", "expected"),
    [
        ({"mine": lambda run: "far"}, "mine: expected a number, or numbers by agent's name"),
        ({"mine": lambda run: {"z": 1.0}}, "mine: expected names of agents, got 'z'"),
        ({"arrived": lambda run: 1.0}, "arrived: expected a name that no other column has"),
        ({"role": lambda run: 1.0}, "role: expected a name that no other column has"),
        ({"seed": lambda run: 1.0}, "seed: expected a name that no other column has"),
    ],
)
def test_a_mistaken_metric_of_ones_own_is_one_line(metric, expected):
    with pytest.raises(ValueError, match=expected):
        phalanx.metrics.of(SimpleNamespace(recording=recording_of()), **metric)


def test_the_task_in_words():
    still = [step(agent, k, 0.1 * k, 0.0) for k in range(100) for agent in "ab"]
    metrics = figures(recording_of([ALONG_X, [4.0, 0.0]], steps=still))
    assert in_words(metrics, ["a", "b"]) == (
        "1 of 2 arrived, tracking error 2.5 m on average, "
        "1 of 2 stood though they wanted to move, from 0 s, least distance 1 m"
    )
    assert metric_rows(metrics)[0][:3] == (SWARM, "2.5", "5")


def test_the_page_has_every_metric_its_unit_and_its_meaning():
    page = (Path(__file__).parents[3] / "docs" / "metrics.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:5]] for line in page.splitlines()]
    listed = {row[0].strip("`"): row[1:3] for row in rows if row and row[0].startswith("`")}
    assert list(listed) == list(METRICS)
    for name, metric in METRICS.items():
        assert listed[name][0] == metric.unit
        assert re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", listed[name][1]) == metric.meaning
    limits = phalanx.metrics.Thresholds()
    for limit in (limits.arrival, limits.still):
        assert f"{limit:g} " in page


def inputs_of(*values: float, nominal: float = 0.0) -> InputSeries:
    """Return scalar inputs of half a second each."""
    u = np.array(values)[:, None]
    return InputSeries(np.full(len(u), 0.5), u, np.full_like(u, nominal))


def test_a_mean_over_time_weighs_by_time_and_not_by_samples():
    t = np.array([0.0, 0.001, 0.002, 2.0])
    assert mean_over_time(t, np.array([1.0, 1.0, 1.0, 1.0])) == pytest.approx(1.0)
    ramp = np.array([0.0, 1.0, 2.0])
    assert mean_over_time(ramp, 3.0 * ramp) == pytest.approx(3.0)
    assert mean_over_time(np.array([7.0]), np.array([4.0])) == 4.0
    assert mean_over_time(np.empty(0), np.empty(0)) is None


def test_an_agent_has_arrived_once_it_stays():
    t = np.arange(6.0)
    assert arrival_time(t, np.array([3.0, 0.4, 2.0, 0.5, 0.2, 0.0]), within=0.5) == 3.0
    assert arrival_time(t, np.zeros(6), within=0.5) == 0.0
    assert arrival_time(t, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.6]), within=0.5) is None


def test_energy_is_the_integral_of_the_square():
    assert input_energy(inputs_of(2.0, 0.0, -4.0)) == pytest.approx(0.5 * (4.0 + 16.0))


def test_a_deviation_is_a_mean_over_the_time_in_which_the_law_is_known():
    inputs = inputs_of(2.0, 0.0, -4.0, nominal=1.0)
    assert input_deviation(inputs) == pytest.approx((1.0 + 1.0 + 5.0) / 3)
    inputs.u_nom[2] = np.nan
    assert input_deviation(inputs) == pytest.approx(1.0)
    inputs.u_nom[:] = np.nan
    assert input_deviation(inputs) is None
