"""The agents in the scene: bodies, safety radii, halos, shadows, inputs and selection."""

from collections.abc import Callable

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx_viewer.scene.colours import DANGER, LIE, Palette
from phalanx_viewer.scene.kinematics import rotations_to
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.nodes import HIDDEN, add_batch, ball, body, disc, ring, single, update
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import in_loop

Click = viser.SceneNodePointerEvent[viser.BatchedMeshHandle]

_FILL, _UNSAFE_FILL = 0.16, 0.5
"""Opacities of the discs of safe and of unsafe agents."""
_LIE_RADIUS = 0.4
"""Radius of the ring of an agent that sent false broadcasts, in bodies."""
_GOAL_RADIUS = 0.3
"""Radius of the mark of an agent's goal, in bodies."""
_LONGEST, _HEAD = 3.5, 0.4
"""Lengths of the longest arrow and of an arrow's head, in bodies."""
_SELECTION_RADIUS = 1.12
"""Radius of the ring, in bodies: a little less than a disc's, so that it crosses no other's."""
_RED = np.array(DANGER, dtype=np.uint8)


class AgentNodes:
    """Nodes that move with the agents.

    All bodies are one batched node, and so are all discs: with a node for each agent, each frame
    would need a message for each agent, too many for the page.
    """

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        n, flat, self._floor = len(model.names), model.flat, model.floor
        self._radii = np.full(n, max(model.radius, 1e-3))
        self._bodies = add_batch(scene, "/agents/bodies", body(flat), n)
        self._fills = add_batch(scene, "/agents/safety radius", ball(flat), n, opacity=1.0)
        self._rims = add_batch(scene, "/agents/rims", ring(0.93), n, lit=False) if flat else None
        halo = ring(0.82) if flat else ball(flat)
        self._halos = add_batch(scene, "/agents/halos", halo, n, opacity=0.45, lit=False)
        self._halos.batched_colors = np.tile(_RED, (n, 1))
        self._liars = add_batch(scene, "/agents/liars", ring(0.45), n, lit=False)
        self._liars.batched_colors = np.tile(np.array(LIE, dtype=np.uint8), (n, 1))
        self.goals = add_batch(scene, "/agents/goals", ring(0.5), n, opacity=0.7, lit=False)
        self._shadows = (
            None if flat else add_batch(scene, "/ground/shadows", disc(), n, opacity=0.3)
        )
        for node in filter(None, (self._fills, self._rims)):
            node.visible = model.radius > 0.0

    def show(self, picture: Picture, sizes: Array) -> None:
        """Move and colour the agents; sizes of the bodies [m], shape (N,)."""
        positions, unsafe = single(picture.positions), picture.unsafe_agents
        discs = {
            "batched_positions": positions,
            "batched_scales": single(self._radii),
            "batched_colors": np.where(unsafe[:, None], _RED, picture.colours),
        }
        update(
            self._bodies,
            batched_positions=positions,
            batched_wxyzs=single(rotations_to(picture.headings)),
            batched_scales=single(sizes),
            batched_colors=picture.colours,
        )
        opacities = single(np.where(unsafe, _UNSAFE_FILL, _FILL))
        update(self._fills, **discs, batched_opacities=opacities)
        if self._rims:
            update(self._rims, **discs)
        halos = np.where(unsafe, np.maximum(1.5 * self._radii, 2.2 * sizes), HIDDEN)
        centers = np.where(unsafe[:, None], positions, 0.0)
        update(self._halos, batched_positions=single(centers), batched_scales=single(halos))
        rings = np.where(picture.liars, _LIE_RADIUS * sizes, HIDDEN)
        above = positions + single(np.outer(rings, [0.0, 0.0, 2.0]))  # the body, which is flat
        update(self._liars, batched_positions=above, batched_scales=single(rings))
        known = np.isfinite(picture.goals[:, :1])
        update(
            self.goals,
            batched_positions=single(np.where(known, picture.goals, 0.0)),
            batched_scales=single(np.where(known[:, 0], _GOAL_RADIUS * sizes, HIDDEN)),
            batched_colors=picture.colours,
        )
        if self._shadows:
            ground = np.column_stack([positions[:, :2], np.full(len(positions), self._floor)])
            shadows = single(0.7 * sizes)
            update(self._shadows, batched_positions=single(ground), batched_scales=shadows)

    def on_click(self, clicked: Callable[[Click], None]) -> None:
        """Call `clicked` when a body is clicked."""
        self._bodies.on_click(in_loop(clicked))


class ArrowNodes:
    """The inputs as arrows: one node for all applied ones, and one for all nominal ones."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        nothing = np.zeros((0, 2, 3))
        self.applied = scene.add_arrows("/arrows/applied", nothing, palette.ink)
        self.u_nom = scene.add_arrows("/arrows/nominal", nothing, palette.faint)

    def show(self, picture: Picture, size: float) -> None:
        """Draw a picture's inputs; size of a body [m]."""
        # Nominal inputs may be many times as large as any applied input: they are cut.
        longest = float(np.linalg.norm(picture.applied, axis=1).max())
        scale = _LONGEST * size / max(1.0, longest)
        # The applied input is drawn above the nominal one, which is often the same.
        for arrows, vectors, height in (
            (self.applied, scale * picture.applied, 0.9 * size),
            (self.u_nom, scale * picture.u_nom, 0.5 * size),
        ):
            lengths = np.linalg.norm(vectors, axis=1)
            seen = lengths > _HEAD * size
            cut = np.minimum(1.0, _LONGEST * size / lengths[seen])
            tails = picture.positions[seen] + [0.0, 0.0, height]
            heads = tails + cut[:, None] * vectors[seen]
            arrows.points = single(np.stack([tails, heads], axis=1))
            update(arrows, shaft_radius=0.08 * size, head_radius=0.2 * size)
            update(arrows, head_length=_HEAD * size)

    def set_palette(self, palette: Palette) -> None:
        self.applied.colors = np.array(palette.ink, dtype=np.uint8)
        self.u_nom.colors = np.array(palette.faint, dtype=np.uint8)


class SelectionNodes:
    """A ring around the selected agent."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        self._ring = scene.add_mesh_simple(
            "/selected", *ring(0.93), color=palette.ink, visible=False, cast_shadow=False
        )

    def show(self, positions: Array, selected: int | None, sizes: Array) -> None:
        """Mark an agent, or none; positions (N, 3) and sizes of the bodies (N,) [m]."""
        self._ring.visible = selected is not None
        if selected is not None:
            self._ring.position = tuple(positions[selected])
            update(self._ring, scale=_SELECTION_RADIUS * float(sizes[selected]))

    def set_palette(self, palette: Palette) -> None:
        self._ring.color = palette.ink


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """Index of the position, of shape (N, 3), nearest to a ray of unit direction."""
    offsets = positions - origin
    along = offsets @ direction
    return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())
