"""phalanx ros2 with a real run: a plain Zenoh session reads it as a node over rmw_zenoh does."""

import contextlib
import json
import socket
import struct
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from phalanx_viewer.scene.model import rotations_to, scene_model

from phalanx.recording.read import read
from phalanx.scenario.load import load
from phalanx.wire.session import open_hub, reserved_endpoint
from tests.process.runs import HELD, PACED, live_run, wait_for

from . import messages as ros

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


SO_FAR = {"guaranteed so far", "safe so far, not guaranteed"}


class Listener:
    """All messages in a domain of ROS 2, and all tokens of its graph."""

    def __init__(self, session: zenoh.Session, domain: int) -> None:
        self.samples: dict[str, list[tuple[bytes, bytes]]] = defaultdict(list)
        """Payload and attachment, by topic and type without its hash."""
        self.tokens: set[str] = set()
        self.announced: set[str] = set()
        self._subscriber = session.declare_subscriber(f"{domain}/**", self._on_sample)
        self._watch = session.liveliness().declare_subscriber(
            f"@ros2_lv/{domain}/**", self._on_token, history=True
        )

    def _on_sample(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).split("/", 1)[1].rsplit("/", 1)[0]
        assert sample.attachment is not None
        self.samples[topic].append((sample.payload.to_bytes(), sample.attachment.to_bytes()))

    def _on_token(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self.tokens.add(token)
            self.announced.add(token)
        else:
            self.tokens.discard(token)

    def messages(self, topic: str, kind: type) -> list:
        return [kind.deserialize(payload) for payload, _ in self.samples[topic]]

    def poses(self, name: str) -> list[ros.PoseStamped]:
        topic = f"phalanx/agent_{name}/pose/geometry_msgs::msg::dds_::PoseStamped_"
        return self.messages(topic, ros.PoseStamped)

    def diagnostics(self) -> list[ros.DiagnosticArray]:
        topic = "diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_"
        return self.messages(topic, ros.DiagnosticArray)

    def markers(self) -> list[ros.MarkerArray]:
        topic = "phalanx/markers/visualization_msgs::msg::dds_::MarkerArray_"
        return self.messages(topic, ros.MarkerArray)


@contextlib.contextmanager
def ros2_router(
    domain: int, before: Callable[[str], None] = lambda endpoint: None
) -> Iterator[tuple[str, Listener]]:
    """A router as rmw_zenohd is one, and a client of it that listens.

    before: called with its endpoint before it is there.
    """
    with reserved_endpoint() as endpoint:
        before(endpoint)
        config = {"mode": "client", "connect": {"endpoints": [endpoint]}}
        with (
            open_hub(endpoint),
            zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session,
        ):
            yield endpoint, Listener(session, domain)


def ros2(run: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "phalanx", "ros2", str(run), *arguments]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def finish(program: subprocess.Popen[str]) -> str:
    """Wait for a successful end, and return the output."""
    _, output = program.communicate(timeout=150)
    assert program.returncode == 0, output
    return output


@pytest.fixture(scope="module")
def heard(tmp_path_factory) -> Iterator[tuple[Path, Listener]]:
    """A live run, all topics of which have a subscriber from near its beginning."""
    scenario = load("unicycles", ["duration=1.5"])
    folder = tmp_path_factory.mktemp("runs") / "live"
    with ros2_router(7) as (router, listener):
        with live_run(scenario, folder, HELD) as run:
            wait_for(lambda: run.status is not None and run.status.t > 0)
            program = ros2(folder, "--router", router, "--domain", "7")
            wait_for(lambda: listener.tokens or program.poll() is not None)
            run.set_speed(PACED.speed)
        finish(program)
        yield folder, listener


def test_every_pose_is_a_state_of_the_recording(heard):
    folder, listener = heard
    recording = read(folder)
    model, times = scene_model(recording.scenario), np.round(recording.times, 9)
    for i, name in enumerate(model.names):
        published = listener.poses(name)
        assert len(published) > 20
        for message in published:
            at = int(np.searchsorted(times, round(message.header.t, 9)))
            assert times[at] == pytest.approx(message.header.t, abs=2e-9)
            poses = model.kinematics.poses(recording.x[at])
            position, turn = message.pose.position, message.pose.orientation
            assert [position.x, position.y, position.z] == poses.positions[i].tolist()
            assert [turn.w, turn.x, turn.y, turn.z] == rotations_to(poses.headings)[i].tolist()


def test_tokens_tell_the_node_and_its_publishers_and_go_with_it(heard):
    _, listener = heard
    (node,) = [token for token in listener.announced if "/NN/" in token]
    head, domain, session, *rest = node.split("/")
    assert (head, domain) == ("@ros2_lv", "7")
    assert rest == ["0", "0", "NN", "%", "%phalanx", "swarm"]
    publishers = [token.split("/") for token in listener.announced - {node}]
    assert {token[2] for token in publishers} == {session}
    assert len({token[4] for token in publishers}) == len(publishers), "each has a number"
    assert {(token[9], token[10]) for token in publishers} >= {
        ("%phalanx%agent_1%pose", "geometry_msgs::msg::dds_::PoseStamped_"),
        ("%phalanx%markers", "visualization_msgs::msg::dds_::MarkerArray_"),
        ("%diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_"),
    }
    wait_for(lambda: not listener.tokens)


def test_messages_of_a_publisher_are_numbered_from_1_on_under_one_gid(heard):
    _, listener = heard
    for samples in listener.samples.values():
        attachments = [struct.unpack("<qqB16s", attachment) for _, attachment in samples]
        assert [number for number, *_ in attachments] == list(range(1, len(samples) + 1))
        assert {length for _, _, length, _ in attachments} == {16}
        assert len({gid for *_, gid in attachments}) == 1
        stamps = [nanoseconds for _, nanoseconds, *_ in attachments]
        assert stamps == sorted(stamps)
    gids = {samples[0][1][-16:] for samples in listener.samples.values()}
    assert len(gids) == len(listener.samples)


def test_the_swarm_is_drawn_and_what_stands_still_comes_again_for_the_late(heard):
    folder, listener = heard
    names = scene_model(read(folder).scenario).names
    groups = [{marker.ns for marker in message.markers} for message in listener.markers()]
    assert all(group >= {"agent", "name", "safety radius"} for group in groups)
    assert 1 < sum("obstacle" in group for group in groups) < len(groups)
    assert [m.text for m in listener.markers()[-1].markers if m.ns == "name"] == list(names)


def test_the_verdict_is_the_last_message(heard):
    folder, listener = heard
    summary = json.loads((folder / "summary.json").read_text())
    statuses = [message.status[0].message for message in listener.diagnostics()]
    assert statuses[-1] == f"{summary['outcome']}: {summary['reason']}"
    assert set(statuses[:-1]) <= SO_FAR


def test_a_recording_is_published_once_in_real_time_and_its_verdict_at_its_end(heard):
    folder, _ = heard
    times = read(folder).times
    with ros2_router(3) as (router, listener):
        finish(ros2(folder, "--router", router, "--domain", "3", "--namespace", "/late"))
    topic = "late/agent_1/pose/geometry_msgs::msg::dds_::PoseStamped_"
    stamps = [message.header.t for message in listener.messages(topic, ros.PoseStamped)]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] == pytest.approx(times[-1])
    statuses = [message.status[0].message for message in listener.diagnostics()]
    assert ": " in statuses[-1]
    assert set(statuses[:-1]) <= SO_FAR


def test_a_recording_begins_when_the_router_is_there(heard):
    folder, _ = heard
    programs = []

    def knock(endpoint: str) -> None:
        """Let a program try for a second to reach the router."""
        programs.append(ros2(folder, "--router", endpoint, "--domain", "4"))
        with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))) as deaf:
            deaf.settimeout(60.0)
            end = np.inf
            while time.monotonic() < end:
                deaf.accept()[0].close()
                end = min(end, time.monotonic() + 1.0)

    with ros2_router(4, knock) as (_, listener):
        finish(programs[0])
    assert listener.poses("1")[0].header.t < 1.0


def test_a_router_that_is_not_there_is_one_line(heard):
    folder, _ = heard
    with reserved_endpoint() as nowhere:
        program = ros2(folder, "--router", nowhere, "--timeout", "0.5")
        _, output = program.communicate(timeout=60)
    assert program.returncode == 3
    assert f"no hub at {nowhere} within 0.5 s" in output
    assert "is rmw_zenohd running there?" in output
    assert "Traceback" not in output
