"""Pairs that left the safe set stand out in the picture, and no others."""

import numpy as np
from msgspec.structs import replace
from phalanx_viewer.scene.model import SceneModel, scene_model
from phalanx_viewer.scene.picture import Picture, past_lines, unsafe_lines
from phalanx_viewer.scene.static import panel
from phalanx_viewer.scene.texts import banner

from phalanx.guarantee.verdict import Violation
from phalanx.messages.frames import AgentStatus, Frame
from phalanx.scenario.load import load

MODEL: SceneModel = scene_model(load("surrounded", []))


def picture(*second: float, turned: tuple[int, ...] = ()) -> Picture:
    """The picture with agent 2 at a point, and the others at the start."""
    x = MODEL.swarm.start().copy()
    x[2:4] = second
    h = MODEL.values.worst_pair(x, turned)
    frame = Frame(
        t=0.0, x=x.tobytes(), h_tot=max(MODEL.values.every_h(x)), h=0.0, worst_h=0.0,
        pair=h, turned=turned, agents=(AgentStatus(),) * 5, link_events=(), steps=0,
        real_time_factor=0.0, assumptions=(), violations=(), log=(), paused=True, speed=0.0,
        loss=None, delay=None,
    )  # fmt: skip
    return Picture(MODEL, frame)


def test_the_two_of_a_pair_too_close_are_marked_and_no_agent_while_all_are_safe() -> None:
    safe = picture(1.001, 0.0)
    assert (safe.unsafe, safe.unsafe_agents.any(), len(safe.unsafe_ends)) == ([], False, 0)
    marked = picture(0.999, 0.0)
    assert [MODEL.label(pair) for pair in marked.unsafe] == ["1-2"]
    assert marked.unsafe_agents.tolist() == [True, True, False, False, False]
    np.testing.assert_array_equal(marked.unsafe_ends, [[[0, 0, 0], [0.999, 0, 0]]])


def test_of_several_pairs_the_one_with_the_largest_h_comes_first() -> None:
    x = MODEL.swarm.start().copy()
    x[2:4], x[4:6] = (0.5, 0.0), (0.0, 0.3)
    labels = [MODEL.label(int(pair)) for pair in MODEL.values.unsafe(x)]
    assert labels == ["1-3", "1-2"]


def test_the_banner_names_the_pair_its_h_and_since_when() -> None:
    x = MODEL.swarm.start().copy()
    x[2:4] = (0.5, 0.0)
    violation = Violation("1-2", 0.25, 2.0, 3.0, duration=1.0, count=2, begin=1.25, end=None)
    p = MODEL.kinematics.poses(x).positions
    unsafe = MODEL.values.unsafe(x).tolist()
    (line,) = unsafe_lines(MODEL, unsafe, (violation,), x, p)
    assert line == "1-2 unsafe: 0.50 m, h = 0.75 where 0 is allowed, since t = 1.250 s"
    assert line in banner([line], [])
    assert past_lines(MODEL, unsafe, (violation,), 2.0) == []


def test_the_banner_keeps_past_violations_but_shows_none_before_they_happen() -> None:
    violation = Violation("1-2", 1.25, 2.0, 3.0, duration=0.5, count=1, begin=1.25, end=1.75)
    assert past_lines(MODEL, [], (violation,), 1.0) == []
    assert past_lines(MODEL, [], (violation,), 2.0) == [
        "1-2 was unsafe from t = 1.250 s to 1.750 s"
    ]
    again = replace(violation, count=3, begin=2.5, end=3.5)
    (line,) = past_lines(MODEL, [], (again,), 4.0)
    assert line == "1-2 was unsafe 3 times, last from t = 2.500 s to 3.500 s, up to h = 2"
    assert "phalanx-past" in banner([], [line])


def test_a_pair_without_a_normal_agent_sounds_no_alarm() -> None:
    marked = picture(0.5, 0.0, turned=(0,))
    assert (marked.unsafe, marked.unsafe_lines) == ([], [])
    assert not marked.unsafe_agents.any()
    assert marked.past_lines == [
        "1-2: 0.50 m, h = 0.75, not counted: no normal agent is left in it"
    ]
    assert picture(0.5, 0.0, turned=(1,)).unsafe_lines, "agent 1 is normal"


def test_a_banner_names_three_pairs_without_markup_and_counts_the_others() -> None:
    assert banner([], []) == ""
    assert "<b>" not in banner(["<b>-2 unsafe"], [])
    marked = banner([f"1-{k} unsafe" for k in range(5)], [])
    assert [f"1-{k} unsafe" in marked for k in range(5)] == [True, True, True, False, False]
    assert "and 2 more pairs" in marked
    assert "and 1 more pair<" in banner([f"1-{k} unsafe" for k in range(4)], [])


def test_an_agent_outside_its_fence_is_unsafe_alone_and_has_no_distance_from_it() -> None:
    model = scene_model(load("fence", []))
    x = model.swarm.start().copy()
    x[:2] = (9.0, 0.0)
    unsafe = model.values.unsafe(x).tolist()
    p = model.kinematics.poses(x).positions
    assert model.agents_of(unsafe) == {0}
    assert unsafe_lines(model, unsafe, (), x, p) == [
        "1-limit 0 unsafe: h = 1.06 where 0 is allowed"
    ]


def test_a_fence_is_drawn_where_the_scenario_has_it() -> None:
    (outline,) = scene_model(load("fence", [])).static.outlines
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 8.0)
    low, high = scene_model(load("fence", [])).extent
    assert (low[:2] < -8.0).all()
    assert (high[:2] > 8.0).all()


def test_each_agent_that_has_a_goal_is_shown_with_it_at_that_time() -> None:
    crossing = scene_model(load("crossing", []))
    x = crossing.swarm.start()
    early, late = (crossing.goals(t, x) for t in (0.0, 4.0))
    east, west, north, south, rogue = range(5)
    np.testing.assert_array_equal(early[east], [-6.0, 0.0, 0.0])
    np.testing.assert_array_equal(early[west], [-6.0, 0.5, 0.0])
    np.testing.assert_allclose(np.linalg.norm(late[west] - early[west]), 4.0, atol=0.01)
    np.testing.assert_allclose(late[north], [1.25, 3.0, 0.0])
    # What counts as reached depends on the samples before; the pursuer has no goal.
    assert np.isnan(late[[south, rogue]]).all()
    assert np.isnan(crossing.goals(0.0, x)).any(axis=1).tolist() == [False] * 3 + [True] * 2


SQUARE = [
    (np.array(normal), 5.0)
    for normal in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0])
]


def test_four_walls_make_a_fence_that_is_closed() -> None:
    ends = []
    for wall in SQUARE:
        others = [other for other in SQUARE if other is not wall]
        corners = panel(wall, others, np.array([1.0, 1.0, 0.0]), 100.0)
        ends.append({tuple(np.round(corner[:2], 9) + 0.0) for corner in corners})
    assert ends[0] == {(5.0, -5.0), (5.0, 5.0)}
    assert set.union(*ends) == {(x, y) for x in (5.0, -5.0) for y in (5.0, -5.0)}


def test_a_wall_alone_reaches_as_far_as_the_scene() -> None:
    corners = panel(SQUARE[0], [], np.array([1.0, 2.0, 3.0]), 10.0)
    np.testing.assert_allclose(corners[:, 0], 5.0)
    assert corners[:, 1].min() == -8.0
    assert corners[:, 1].max() == 12.0


def test_a_wall_beyond_another_is_not_there() -> None:
    farther = SQUARE[0][0], 7.0
    assert len(panel(farther, SQUARE, np.zeros(3), 10.0)) == 0


def test_a_floor_and_a_ceiling_bound_a_wall_in_space() -> None:
    floor, ceiling = (np.array([0.0, 0.0, -1.0]), 0.0), (np.array([0.0, 0.0, 1.0]), 3.0)
    corners = panel(SQUARE[0], [floor, ceiling, *SQUARE[2:]], np.zeros(3), 100.0)
    assert {tuple(np.round(c, 9) + 0.0) for c in corners} == {
        (5.0, y, z) for y in (-5.0, 5.0) for z in (0.0, 3.0)
    }
