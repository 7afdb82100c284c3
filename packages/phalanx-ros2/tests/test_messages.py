"""ROS 2 messages of a run, decoded by another library than the one that encodes."""

import msgspec
import numpy as np
import pytest
from phalanx_ros2 import messages
from phalanx_ros2.cdr import message_type, serialized
from phalanx_ros2.messages import (
    diagnostics,
    heads,
    interim_head,
    last_head,
    pose_messages,
)
from phalanx_ros2.republisher import agent_topics
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import verdict_text
from phalanx_viewer.scene.model import SceneModel, rotations_to, scene_model
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray

import phalanx
from phalanx.cli.app import USAGE_ERROR, status
from phalanx.guarantee.verdict import Assumption

from . import messages as ros


@pytest.fixture(scope="module")
def replay() -> Replay:
    """Agents that a wall and an adversary press together, until two of them collide."""
    return Replay(phalanx.run("surrounded", engine="in-process").recording)


def state(replay: Replay, t: float) -> np.ndarray:
    return np.frombuffer(replay.frame(t).x)


def markers_at(replay: Replay, t: float) -> dict[tuple[str, int], ros.Marker]:
    """Every marker of a moment, by name and number."""
    frame, x, model = replay.frame(t), state(replay, t), replay.model
    poses, unsafe = model.kinematics.poses(x), [int(pair) for pair in model.values.unsafe(x)]
    message = messages.array(
        messages.agents(frame.t, model, poses, frame.agents, unsafe),
        messages.violations(frame.t, model, poses.positions, unsafe),
        messages.static_markers(frame.t, model),
    )
    markers = ros.MarkerArray.deserialize(serialized(message)).markers
    by_name = {(marker.ns, marker.id): marker for marker in markers}
    assert len(by_name) == len(markers), "one would take the place of the other"
    return by_name


# The first from docs/design.md of ros2/rmw_zenoh, the others from ROS 2 clients in other languages.
ON_THE_WIRE = {
    String: "std_msgs::msg::dds_::String_/RIHS01_"
    "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    PoseStamped: "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_"
    "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    MarkerArray: "visualization_msgs::msg::dds_::MarkerArray_/RIHS01_"
    "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    Diagnostics: "diagnostic_msgs::msg::dds_::DiagnosticArray_/RIHS01_"
    "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}


@pytest.mark.parametrize("kind", ON_THE_WIRE)
def test_types_are_named_and_hashed_as_ros_2_does(kind):
    assert message_type(kind).on_the_wire == ON_THE_WIRE[kind]


@pytest.mark.slow
def test_a_pose_is_little_endian_cdr_of_where_an_agent_is_and_faces():
    run = phalanx.run(phalanx.load("unicycles", ["duration=0.1"]), engine="in-process")
    model, x = scene_model(run.scenario), run.recording.x[-1]
    poses = model.kinematics.poses(x)
    payloads = [serialized(message) for message in pose_messages(12.000000001, poses)]
    assert {payload[:4] for payload in payloads} == {bytes([0, 1, 0, 0])}
    for i, payload in enumerate(payloads):
        stamped = ros.PoseStamped.deserialize(payload)
        assert (stamped.header.stamp.sec, stamped.header.stamp.nanosec) == (12, 1)
        assert stamped.header.frame_id == "world"
        position, turn = stamped.pose.position, stamped.pose.orientation
        assert [position.x, position.y, position.z] == poses.positions[i].tolist()
        assert [turn.w, turn.x, turn.y, turn.z] == rotations_to(poses.headings)[i].tolist()


def test_every_agent_is_an_arrow_with_its_name_and_its_safety_radius(replay):
    markers, names = markers_at(replay, 0.0), replay.model.names
    for i, name in enumerate(names):
        position = replay.history.trajectory[0][i]
        disc = markers["safety radius", i]
        assert disc.type == ros.CYLINDER
        assert (disc.scale.x, disc.scale.y) == (1.0, 1.0), "two touch at the radius of 1 m"
        assert [disc.pose.position.x, disc.pose.position.y] == position[:2].tolist()
        assert markers["agent", i].type == ros.ARROW
        assert markers["name", i].text == name
    assert markers["agent", 0].color.b > markers["agent", 0].color.r, "the normal one is blue"
    assert markers["agent", 1].color.r > markers["agent", 1].color.b, "adversaries are red"


def test_a_violated_pair_is_red_and_joined_by_a_line_which_is_gone_before(replay):
    line = ("violated pairs", 0)
    before, after = markers_at(replay, 0.5), markers_at(replay, replay.end)
    assert before[line].action == ros.DELETE
    pairs = len(replay.summary.violations)
    assert (after[line].action, after[line].type) == (ros.ADD, ros.LINE_LIST)
    assert len(after[line].points) == 2 * pairs
    assert after["agent", 0].color.r > after["agent", 0].color.b


def static_markers(model: SceneModel) -> list[ros.Marker]:
    message = messages.array(messages.static_markers(0.0, model))
    markers: list[ros.Marker] = ros.MarkerArray.deserialize(serialized(message)).markers
    return markers


def test_obstacles_are_spheres_of_what_their_clearance_leaves_to_see():
    model = scene_model(phalanx.load("unicycles"))
    message = ros.MarkerArray.deserialize(
        serialized(messages.array(messages.static_markers(0.0, model)))
    )
    spheres = [marker for marker in message.markers if marker.ns == "obstacle"]
    assert spheres
    for marker, (center, radius) in zip(spheres, model.static.spheres, strict=True):
        center_drawn = marker.pose.position
        assert [center_drawn.x, center_drawn.y, center_drawn.z] == center.tolist()
        assert marker.scale.x == 2.0 * radius


def test_a_fence_is_a_line_around_where_one_may_be():
    model = scene_model(phalanx.load("fence"))
    message = ros.MarkerArray.deserialize(
        serialized(messages.array(messages.static_markers(0.0, model)))
    )
    (fence,) = [marker for marker in message.markers if marker.ns == "limit"]
    assert [(p.x, p.y, p.z) for p in fence.points] == [
        tuple(point) for point in model.static.outlines[0].tolist()
    ]


def test_diagnostics_hold_the_run_and_every_agent(replay):
    frame, model = replay.frame(replay.end), replay.model
    head = last_head(replay.summary, "")
    message = ros.DiagnosticArray.deserialize(serialized(diagnostics(frame, model, head)))
    run, *agents = message.status
    assert (run.level, run.name) == (ros.ERROR, "phalanx: run")
    assert run.message == f"violated: {replay.summary.reason}"
    figures = {value.key: value.value for value in run.values}
    assert float(figures["h_tot"]) == frame.h_tot
    assert figures["worst pair"] == model.label(frame.pair)
    assert [status.name for status in agents] == [f"phalanx: agent {n}" for n in model.names]
    assert {status.message for status in agents[1:]} == {"adversary"}
    assert agents[0].level in (ros.WARN, ros.ERROR), "surrounded, it has no authority"


def test_a_run_is_guaranteed_safe_or_violated_so_far_as_on_its_page(replay):
    start, end = replay.frame(0.1), replay.frame(replay.end)
    fine = msgspec.structs.replace(start, assumptions=())
    failed = msgspec.structs.replace(start, assumptions=(Assumption("punctual", 1, 2, 0.1, ""),))
    assert interim_head(fine) == (ros.OK, "guaranteed so far")
    assert interim_head(failed) == (ros.WARN, "safe so far, not guaranteed")
    level, message = interim_head(end)
    assert level == ros.ERROR
    assert message.startswith("violated so far: 1-2")
    for frame in fine, failed, end:
        words = interim_head(frame)[1].partition(":")[0].replace(" so far", "")
        text = verdict_text(frame, None, "").replace(" so far</b>", "").replace("<b>", "")
        assert words in text


def test_without_a_verdict_the_last_status_says_why():
    why = "it ends in the middle of a chunk"
    assert last_head(None, why) == (ros.ERROR, f"no verdict: {why}")


def test_only_levels_and_messages_make_diagnostics_differ(replay):
    start, soon, end = (
        heads(diagnostics(frame, replay.model, interim_head(frame)))
        for frame in map(replay.frame, (0.1, 0.2, replay.end))
    )
    assert start == soon
    assert start != end


def test_topics_have_names_that_ros_2_allows():
    assert agent_topics("/phalanx", ["1", "lead-a"]) == [
        "/phalanx/agent_1",
        "/phalanx/agent_lead_a",
    ]
    with pytest.raises(ValueError, match="agents a-b and a_b would share the topic /x/agent_a_b"):
        agent_topics("/x", ["a-b", "a_b"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected either RUN or --run"),
        (["runs/x", "--namespace", "phalanx"], "--namespace: expected such as /phalanx"),
        (["runs/x", "--namespace", "/1"], "--namespace: expected such as /phalanx"),
        (["runs/x", "--domain", "233"], "--domain"),
    ],
)
def test_wrong_usage_is_one_line(arguments, message, capsys):
    assert status(["ros2", *arguments]) == USAGE_ERROR
    assert message in capsys.readouterr().err
