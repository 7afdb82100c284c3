"""Choices of gains, margin, laws, goals and obstacles: what may be given, and what is refused."""

import numpy as np
import pytest

import phalanx
from phalanx.scenario.load import from_json, load, read_table
from phalanx.scenario.model import ScenarioError, to_json
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.safety.class_k import Linear
from tests.unit.scenario.refusals import cases, refusal


def test_alpha_may_be_a_number_or_a_table():
    given = ['safety.alpha=[1.5, {type = "power", gain = 2.0, exponent = 3.0}]']
    first, second = load("formation3d", given).safety.class_k
    assert first == Linear(1.5)
    assert (type(second).__name__, second.gain, second.exponent) == ("Power", 2.0, 3.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('safety.alpha=[{type = "power", gain = 2.0}]', r"safety.alpha.*exponent"),
        ("safety.composition=both", "safety.composition: expected 'lse' or 'pairs'"),
        ("safety.neighbourhood=-1.0", "safety.neighbourhood"),
        ("agents.1.law.targets={4 = 'nobody'}", "law of 4: targets: expected one of"),
        ("agents.0.law.gains=[1.0]", r"gains: .*needs 2"),
    ],
)
def test_what_is_wrong_is_named(override, message):
    with pytest.raises(ScenarioError, match=message):
        build_swarm(load("formation3d", [override])).law(4)


def test_the_integrated_margin_needs_a_linear_last_gain():
    power = 'safety.alpha=[{type = "power", gain = 2.0, exponent = 3.0}]'
    with pytest.raises(ScenarioError, match=r"safety\.alpha\.0: expected a number"):
        load("guaranteed", [power])
    assert load("guaranteed", [power, "safety.margin=local"]).safety.computes_margin


@pytest.mark.parametrize("margin", ["corrected", "local", "integrated"])
def test_one_row_for_all_pairs_has_the_papers_margin(margin):
    message = r"safety\.margin: expected 'paper', or composition = 'pairs': see docs/retired\.md"
    with pytest.raises(ScenarioError, match=message):
        load("unicycles", [f"safety.margin={margin}", "safety.eta=0"])


def test_without_a_choice_each_pair_has_a_row_of_which_agents_keep_halves():
    table = read_table("unicycles")
    safety = {k: v for k, v in table["safety"].items() if k not in ("composition", "information")}
    found = load({**table, "safety": safety}).safety
    assert (found.composition, found.information) == ("pairs", "split")


def test_halves_are_of_pairs():
    message = r"safety\.information: expected another, or composition = 'pairs': see docs/retired"
    with pytest.raises(ScenarioError, match=message):
        load("unicycles", ["safety.information=split"])
    assert load("unicycles", ["safety.information=split", "safety.control=centralised"])


def test_a_computed_margin_has_no_eta():
    with pytest.raises(ScenarioError, match=r"safety\.eta: expected no value"):
        load("guaranteed", ["safety.eta=1.0"])


def test_a_wall_without_a_direction_is_refused():
    with pytest.raises(ScenarioError, match=r"obstacles\.0.*normal: expected a direction"):
        load("pinned", ["obstacles.0.normal=[0.0, 0.0]"])


# By a goal of an agent in the plane.
MISTAKES = """
[1.0] | .position: expected at least 2 items
[1.0, 2.0, 3.0] | : expected 2 coordinates, as the agents'
["x", 1.0] | .position.0: expected a valid number
[nan, 1.0] | : expected finite numbers
{points=[[1, 2], [1, 3]]} | : expected a field type, one of point, waypoints, path
{type="curve"} | : expected one of point, waypoints, path
{type="path", points=[[1, 2]], speed=1} | .points: expected at least 2 items
{type="path", points=[[1, 2], [1, 2]], speed=1} | : expected points that differ from the one before
{type="path", points=[[1, 2], [1, 3]]} | .speed: expected a value
{type="path", points=[[1, 2], [1, 3]], speed=0} | .speed: expected greater than 0
{type="waypoints", points=[[1, 2], [1, 3]]} | : expected either times or a tolerance
{type="waypoints", points=[[1, 2], [1, 3]], times=[0, 1], tolerance=1} | : expected either times
{type="waypoints", points=[[1, 2], [1, 3]], times=[1]} | : expected a time for each of the 2 points
{type="waypoints", points=[[1, 2], [1, 3]], times=[1, 1]} | : expected times that increase
{type="waypoints", points=[[1, 2], [1, 2, 3]], tolerance=1} | : expected points that are all 2-D or
{type="point", at=[1, 2]} | .at: unknown field (misspelt
"""


@pytest.mark.parametrize(("goal", "message"), cases(MISTAKES))
def test_a_mistaken_goal_is_one_line(goal, message):
    lines = refusal([f"agents.0.goal.0={goal}"], "crossing").splitlines()
    assert any(line.startswith(f"crossing: agents.0.goal.0{message}") for line in lines)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("goal", [1.0, 2.0], "expected a list with one for each agent, such as [[4.0, 2.0]]"),
        ("goal", {"type": "point"}, "expected a list with one for each agent"),
        ("goal", [[1.0, 2.0]], "expected one for each of the 4 agents"),
        ("slots", [0, 1, 2, 3], "expected goal or slots, not both"),
        ("law", {"type": "pursue"}, "expected none: the law pursue does not steer by a goal"),
    ],
)
def test_goals_that_do_not_fit_their_group_are_one_line(field, value, message):
    (line,) = refusal({f"agents.0.{field}": value}, "crossing").splitlines()
    assert line.startswith(f"crossing: agents.0.goal: {message}")


def test_a_goal_survives_being_written_and_read():
    scenario = load("crossing")
    assert from_json(to_json(scenario)).agents == scenario.agents


def test_a_point_may_be_overridden_by_its_place():
    swarm = build_swarm(load("crossing", ["agents.0.goal.3=[1.0, 2.0]"]))
    assert swarm.goal(3).reference.end().tolist() == [1.0, 2.0]


def test_agents_without_goal_have_none():
    swarm = build_swarm(load("crossing"))
    assert [swarm.has_goal(i) for i in range(5)] == [True] * 4 + [False]
    assert not build_swarm(load("surrounded")).has_goal(0)


CORNERS = [[3.0, -2.0], [6.5, -3.0], [3.0, -4.0]]


def test_a_polygon_is_for_agents_in_the_plane():
    with pytest.raises(ScenarioError, match=r"obstacles.0.corners: expected 3 coordinates, as the"):
        load("formation3d", {"scatter": None, "obstacles": [{"corners": CORNERS}]})


def test_a_polygon_is_written_and_read_again():
    scenario = load("unicycles", {"obstacles": [{"corners": CORNERS, "rounding": 0.2}]})
    (polygon,) = from_json(to_json(scenario)).obstacles
    assert polygon == scenario.obstacles[0]
    assert polygon.rounding == 0.2


@pytest.mark.nightly
@pytest.mark.slow
def test_carts_are_proven_safe_from_a_ramp_and_from_a_truck_that_crosses_their_path():
    run = phalanx.run("warehouse", engine="in-process")
    assert run.verdict == "guaranteed"
    ramp = run.scenario.obstacles[2]
    states, carts = run.states, ("cart-1", "cart-2", "cart-3")
    truck = states.select("truck.x", "truck.y").to_numpy()
    assert np.linalg.norm(truck[-1] - truck[0]) > 6.5
    least = run.metrics["least_distance"][-1]
    assert 1.0 <= least < 1.1, "the truck is what came nearest"
    nearest = [ramp.distances(output_points(states, cart)).min() - ramp.clearance for cart in carts]
    assert 0.0 <= min(nearest) < 0.3, "a cart has to go around the ramp"


def output_points(states, cart: str) -> np.ndarray:
    x, y, theta = (states[f"{cart}.{name}"].to_numpy() for name in ("x", "y", "theta"))
    return np.column_stack([x + 0.25 * np.cos(theta), y + 0.25 * np.sin(theta)])


@pytest.mark.parametrize("seed", range(5))
def test_random_obstacles_keep_apart_and_clear_of_every_start(seed):
    scenario = load("formation3d", ["scatter.along=[0.0, 0.5]", "scatter.apart=5.0"], seed=seed)
    centers = np.array([o.center for o in scenario.obstacles])
    starts = build_swarm(scenario).start().reshape(8, 6)[:, :3]
    between = np.linalg.norm(centers[:, None] - centers[None], axis=2) + 1e9 * np.eye(10)
    assert len(centers) == 10
    assert between.min() >= 5.0
    assert np.linalg.norm(centers[:, None] - starts[None], axis=2).min() >= 25.0


def test_random_obstacles_follow_the_seed_and_are_part_of_the_resolved_scenario():
    one, two = load("formation3d", seed=1), load("formation3d", seed=2)
    assert one.obstacles != two.obstacles
    assert one == load("formation3d", seed=1)
    assert from_json(to_json(one)).obstacles == one.obstacles
    assert one.scatter is None


def test_no_room_for_obstacles_is_an_error_that_names_the_field():
    with pytest.raises(ScenarioError, match="scatter: no room for 10 obstacles"):
        load("formation3d", ["scatter.apart=1000.0"])
