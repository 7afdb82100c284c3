"""The legend names everything that is drawn, of a plane or of space."""

import numpy as np
import pytest
from phalanx_viewer.scene.legend import BELIEFS, Mark, legend, marks_of
from phalanx_viewer.scene.model import SceneModel, scene_model
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.scene import Scene
from phalanx_viewer.scene.server import SceneServer
from viser._messages import _CreateSceneNodeMessage

from phalanx.messages.frames import AgentStatus, Frame
from phalanx.scenario.load import load

MARKS = {
    "agents/bodies": "normal",
    "agents/safety radius": "circles touch where h = 0",
    "agents/rims": "circles touch where h = 0",
    "agents/halos": "unsafe: h above 0",
    "agents/liars": "sent a false broadcast",
    "agents/goals": "goal",
    "arrows/applied": "applied input",
    "beliefs": "believed now",
    "arrows/nominal": "nominal input",
    "formation/corridor": "width of the formation",
    "formation/path": "path of the formation's middle",
    "ground/drops": "height over the ground",
    "ground/shadows": "height over the ground",
    "limits": "obstacle or limit",
    "links": "late link",
    "obstacles": "obstacle or limit",
    "recent paths": "recent path",
    "selected": "chosen agent",
    "unsafe pairs": "unsafe: h above 0",
    "worst pair": "worst pair",
    "leader": "worst pair",
}
RARE = {Mark.UNSAFE, Mark.LIE, Mark.LATE, Mark.LOST}
"""Marks of nodes that are drawn in every scene, but hidden until a run has them."""
PLAIN = {"", "WorldAxes", "ground/grid", "labels", "lights"}
"""Without a mark: light, grid, and texts."""


def mark(node: str) -> str | None:
    """The text of a node's mark; None if it needs none."""
    known = MARKS | dict.fromkeys(PLAIN)
    return known[node] if node in known else known[node.split("/")[0]]


def start_of(model: SceneModel) -> Picture:
    x = model.swarm.start()
    pair = model.values.worst_pair(x)
    frame = Frame(
        t=0.0, x=x.tobytes(), h_tot=-1.0, h=-1.0, worst_h=-1.0, pair=pair, turned=(),
        agents=(AgentStatus(),) * len(model.names), link_events=(), steps=0, real_time_factor=0.0,
        assumptions=(), violations=(), log=(), paused=True, speed=0.0, loss=None, delay=None,
    )  # fmt: skip
    return Picture(model, frame)


@pytest.fixture
def server():
    opened = SceneServer("127.0.0.1", 0, "legend")
    yield opened
    opened.stop()


@pytest.mark.parametrize(
    "name", ["unicycles", "formation3d", "fence", "surrounded", "warehouse", "radio"]
)
def test_everything_that_is_drawn_has_a_mark(server: SceneServer, name: str) -> None:
    model = scene_model(load(name))
    Scene(server, model, lambda _: None)
    messages = server._websock_server._broadcast_buffer.message_from_id.values()
    nodes = {m.name.strip("/") for m in messages if isinstance(m, _CreateSceneNodeMessage)}
    parents = {node.rpartition("/")[0] for node in nodes}
    empty = {"ground/drops"} if model.flat else set()
    empty |= set() if model.has_goals else {"agents/goals"}
    if not model.swarm.by_radio:
        empty |= {node for node in nodes if node.startswith("beliefs/")}
    marks = {mark(node) for node in nodes - parents - empty} - {None}
    assert "normal" in marks
    entries = {text for text, *_ in legend(marks_of(model) | RARE | BELIEFS)}
    assert marks <= entries
    assert ("height over the ground" in entries) is not model.flat


def test_a_line_leads_from_the_worst_pair_to_its_text(server: SceneServer) -> None:
    model = scene_model(load("unicycles"))
    scene = Scene(server, model, lambda _: None)
    picture = start_of(model)
    scene.show(picture, None)
    leader = server.scene.get_handle_by_name("/leader")
    labels = [server.scene.get_handle_by_name(f"/labels/{k}") for k in range(6)]
    (text,) = [label for label in labels if label.text == picture.worst_pair_text]
    begin, end = leader.points[0]
    np.testing.assert_allclose(begin, np.mean(picture.worst_pair, axis=0), atol=1e-5)
    np.testing.assert_allclose(end, text.position, atol=1e-5)
    assert leader.visible


def test_every_letter_is_there_before_a_text_needs_it(server: SceneServer) -> None:
    """viser draws new letters over some pictures, and in these shows old texts at new places."""
    model = scene_model(load("unicycles"))
    Scene(server, model, lambda _: None)
    letters = set(server.scene.get_handle_by_name("/labels/letters").text)
    x = model.swarm.start()
    p = model.kinematics.poses(x).positions
    for pair in range(len(model.swarm.safe_set.pairs)):
        for scale in (1e-9, 1.0, 1e9):
            text = f"{model.label(pair)}: {model.pair_text(pair, scale * x, p)}"
            assert set(text) - {" "} <= letters, text


def test_a_name_without_room_next_to_its_agent_is_farther_away_at_the_end_of_a_line(
    server: SceneServer,
) -> None:
    model = scene_model(load("unicycles"))
    scene = Scene(server, model, lambda _: None)
    picture = start_of(model)
    spread = np.arange(5.0)[:, None] * [0.1, 0.0, 0.0]
    picture.positions = picture.positions.mean(axis=0) + spread
    scene.show(picture, None)
    labels = [server.scene.get_handle_by_name(f"/labels/{k}") for k in range(6)]
    at = {label.text: np.array(label.position) for label in labels if label.visible}
    assert set(model.names) < set(at), "none is left out"
    ends = server.scene.get_handle_by_name("/leader").points[:, 1]
    led = [n for n in model.names if np.linalg.norm(ends - at[n], axis=1).min() < 1e-3]
    assert len(led) >= 2
    p = dict(zip(model.names, picture.positions, strict=True))
    away = {name: float(np.linalg.norm(at[name] - p[name])) for name in model.names}
    next_to = [away[name] for name in model.names if name not in led]
    assert next_to
    assert min(away[name] for name in led) > max(next_to)
