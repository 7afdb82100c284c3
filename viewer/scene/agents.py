"""The agents in the scene: bodies, discs, names, and arrows of their inputs."""

from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.geometry import facing
from phalanx.viewer.scene.meshes import ball, body
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import Picture

Array = NDArray[np.float64]
Click = viser.SceneNodePointerEvent[viser.BatchedMeshHandle]

_APPLIED, _NOMINAL = (30, 41, 59), (160, 174, 192)


class AgentNodes:
    """Nodes that move with the agents.

    All bodies are one batched node, and so are all discs and all arrows: a node for each agent
    would cost a message for each agent and frame, and the page could not keep up.
    """

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        self._size = model.body
        self._bodies, self._discs = _bodies(scene, model), _discs(scene, model)
        self._applied = _arrows(scene, "/arrows/applied", model, _APPLIED)
        self._u_nom = _arrows(scene, "/arrows/nominal", model, _NOMINAL)
        names = () if model.crowded else model.names  # a name is a node of its own
        self._names = [
            scene.add_label(f"/agents/names/{name}", name, anchor="bottom-left") for name in names
        ]

    def show(self, picture: Picture) -> None:
        """Move and colour them."""
        positions, colours = picture.positions, picture.colours
        self._bodies.batched_positions = positions.astype(np.float32)
        self._bodies.batched_wxyzs = facing(picture.headings).astype(np.float32)
        self._bodies.batched_colors = colours
        self._discs.batched_positions = positions.astype(np.float32)
        self._discs.batched_colors = colours
        # Few agents: all named. Many: no name is there at all.
        for name, position in zip(self._names, positions, strict=False):
            name.position = tuple(position)
        self._show_arrows(picture)

    def set_arrows_visible(self, visible: bool) -> None:
        """Applied and nominal inputs."""
        self._applied.visible = self._u_nom.visible = visible

    def on_click(self, clicked: Callable[[Click], None]) -> None:
        """Call `clicked` when a body is clicked; in a thread of viser's."""
        self._bodies.on_click(clicked)

    def _show_arrows(self, picture: Picture) -> None:
        above_body = picture.positions + np.array([0.0, 0.0, 0.6 * self._size])
        longest = float(np.linalg.norm(picture.u_nom, axis=1).max())
        scale = 2.5 * self._size / max(1.0, longest)
        self._applied.points = _segments(above_body, picture.applied * scale)
        self._u_nom.points = _segments(above_body, picture.u_nom * scale)


def _bodies(scene: viser.SceneApi, model: SceneModel) -> viser.BatchedMeshHandle:
    return scene.add_batched_meshes_simple(
        "/agents/bodies",
        *body(model.flat, model.body),
        batched_wxyzs=_upright(model),
        batched_positions=np.zeros((len(model.names), 3)),
        lod="off",  # so few faces leave nothing to simplify
        flat_shading=True,
    )


def _discs(scene: viser.SceneApi, model: SceneModel) -> viser.BatchedMeshHandle:
    return scene.add_batched_meshes_simple(
        "/agents/safety radius",
        *ball(model.flat, max(model.radius, 1e-3)),
        batched_wxyzs=_upright(model),
        batched_positions=np.zeros((len(model.names), 3)),
        opacity=0.3,
        lod="off",
        cast_shadow=False,
        visible=model.radius > 0.0,
    )


def _arrows(
    scene: viser.SceneApi, name: str, model: SceneModel, colour: tuple[int, int, int]
) -> viser.ArrowsHandle:
    return scene.add_arrows(
        name,
        np.zeros((len(model.names), 2, 3)),
        colour,
        shaft_radius=0.09 * model.body,
        head_radius=0.22 * model.body,
        head_length=0.4 * model.body,
    )


def _upright(model: SceneModel) -> Array:
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(model.names), 1))


def _segments(starts: Array, vectors: Array) -> NDArray[np.float32]:
    return np.stack([starts, starts + vectors], axis=1).astype(np.float32)
