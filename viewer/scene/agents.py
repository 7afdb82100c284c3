"""The agents in the scene: bodies, safety radii, halos, and arrows of their inputs."""

from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.geometry import facing
from phalanx.viewer.scene.meshes import Mesh, ball, body, disc, ring
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.palette import DANGER, Colour, Palette
from phalanx.viewer.scene.picture import Colours, Picture

Array = NDArray[np.float64]
Click = viser.SceneNodePointerEvent[viser.BatchedMeshHandle]

_FILL, _ALARM = 0.16, 0.5
"""Opacities of the discs of agents that are safe, and of those that are not."""
_HIDDEN = 1e-6
"""Scale of what is not shown: a batch keeps its number of instances."""
_ARROW = 3.5
"""Length of the longest arrow, in bodies."""


class AgentNodes:
    """Nodes that move with the agents.

    All bodies are one batched node, and so are all discs and all arrows: a node for each agent
    would cost a message for each agent and frame, and the page could not keep up.
    """

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        n, flat = len(model.names), model.flat
        self._model = model
        self._bodies = _batch(scene, "/agents/bodies", body(flat), n)
        self._fills = _batch(scene, "/agents/safety radius", ball(flat), n, opacity=1.0)
        self._rims = _batch(scene, "/agents/rims", ring(0.93), n, lit=False)
        self._halos = _batch(scene, "/agents/halos", _halo(flat), n, opacity=0.45, lit=False)
        self._fills.visible = model.radius > 0.0
        self._rims.visible = model.radius > 0.0 and flat
        self._applied = _arrows(scene, "/arrows/applied", model, palette.ink)
        self._u_nom = _arrows(scene, "/arrows/nominal", model, palette.faint)
        self._shadows = None if flat else _batch(scene, "/ground/shadows", disc(), n, opacity=0.3)

    def show(self, picture: Picture, sizes: Array) -> None:
        """Move and colour them; sizes of the bodies [m], shape (N,)."""
        positions, alarmed = picture.positions, picture.unsafe_agents
        discs = np.full(len(positions), max(self._model.radius, 1e-3))
        colours = np.where(alarmed[:, None], np.array(DANGER), picture.colours).astype(np.uint8)
        _place(self._bodies, positions, sizes, picture.colours)
        self._bodies.batched_wxyzs = facing(picture.headings).astype(np.float32)
        _place(self._fills, positions, discs, colours)
        self._fills.batched_opacities = np.where(alarmed, _ALARM, _FILL).astype(np.float32)
        _place(self._rims, positions, discs, colours)
        around = np.where(alarmed, np.maximum(1.5 * discs, 2.2 * sizes), _HIDDEN)
        _place(self._halos, positions, around, np.tile(DANGER, (len(positions), 1)))
        if self._shadows:
            below = positions * [1.0, 1.0, 0.0] + [0.0, 0.0, self._model.floor]
            _place(self._shadows, below, 0.7 * sizes, np.zeros((len(positions), 3)))
        self._show_arrows(picture, float(np.median(sizes)))

    def set_palette(self, palette: Palette) -> None:
        """Wear the colours of a page."""
        self._applied.colors, self._u_nom.colors = (
            np.array([palette.ink]),
            np.array([palette.faint]),
        )

    def set_arrows_visible(self, visible: bool) -> None:
        """Applied and nominal inputs."""
        self._applied.visible = self._u_nom.visible = visible

    def on_click(self, clicked: Callable[[Click], None]) -> None:
        """Call `clicked` when a body is clicked; in a thread of viser's."""
        self._bodies.on_click(clicked)

    def _show_arrows(self, picture: Picture, size: float) -> None:
        longest = float(np.linalg.norm(picture.u_nom, axis=1).max())
        scale = _ARROW * size / max(1.0, longest)
        shown = (self._applied, picture.applied, 0.9), (self._u_nom, picture.u_nom, 0.5)
        for arrows, vectors, height in shown:  # the applied input above the nominal one
            above_body = picture.positions + np.array([0.0, 0.0, height * size])
            seen = np.linalg.norm(vectors, axis=1) * scale > 0.4 * size  # as long as a head
            arrows.points = _segments(above_body[seen], vectors[seen] * scale)
            arrows.shaft_radius, arrows.head_radius = 0.08 * size, 0.2 * size
            arrows.head_length = 0.4 * size


def _halo(flat: bool) -> Mesh:
    return ring(0.82) if flat else ball(flat)


def _batch(
    scene: viser.SceneApi, name: str, mesh: Mesh, n: int, opacity: float | None = None,
    lit: bool = True,
) -> viser.BatchedMeshHandle:  # fmt: skip
    return scene.add_batched_meshes_simple(
        name, *mesh, batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        batched_positions=np.zeros((n, 3)), batched_scales=np.ones(n),
        batched_colors=np.zeros((n, 3), dtype=np.uint8), opacity=opacity,
        lod="off",  # so few faces leave nothing to simplify
        flat_shading=lit, cast_shadow=False, receive_shadow=False,
    )  # fmt: skip


def _place(
    node: viser.BatchedMeshHandle, positions: Array, sizes: Array, colours: Colours | Array
) -> None:
    node.batched_positions = positions.astype(np.float32)
    node.batched_scales = sizes.astype(np.float32)
    node.batched_colors = colours.astype(np.uint8)


def _arrows(
    scene: viser.SceneApi, name: str, model: SceneModel, colour: Colour
) -> viser.ArrowsHandle:
    return scene.add_arrows(name, np.zeros((len(model.names), 2, 3)), colour)


def _segments(starts: Array, vectors: Array) -> NDArray[np.float32]:
    return np.stack([starts, starts + vectors], axis=1).astype(np.float32)
