"""The agents in the scene: bodies, safety radii, halos and shadows."""

from collections.abc import Callable

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx_viewer.scene.colours import DANGER, LIE
from phalanx_viewer.scene.geometry import facing
from phalanx_viewer.scene.meshes import ball, body, disc, ring
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.nodes import HIDDEN, add_batch, single, update
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import in_loop

Click = viser.SceneNodePointerEvent[viser.BatchedMeshHandle]

_FILL, _ALARM = 0.16, 0.5
"""Opacities of the discs of agents that are safe, and of those that are not."""
_BADGE = 0.4
"""Radius of a liar's ring, in bodies."""
_RED = np.array(DANGER, dtype=np.uint8)


class AgentNodes:
    """Nodes that move with the agents.

    All bodies are one batched node, and so are all discs: a node for each agent would cost a
    message for each agent and frame, and the page could not keep up.
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
        self._shadows = (
            None if flat else add_batch(scene, "/ground/shadows", disc(), n, opacity=0.3)
        )
        for node in filter(None, (self._fills, self._rims)):
            node.visible = model.radius > 0.0

    def show(self, picture: Picture, sizes: Array) -> None:
        """Move and colour them; sizes of the bodies [m], shape (N,)."""
        positions, alarmed = single(picture.positions), picture.unsafe_agents
        discs = {
            "batched_positions": positions,
            "batched_scales": single(self._radii),
            "batched_colors": np.where(alarmed[:, None], _RED, picture.colours),
        }
        update(
            self._bodies,
            batched_positions=positions,
            batched_wxyzs=single(facing(picture.headings)),
            batched_scales=single(sizes),
            batched_colors=picture.colours,
        )
        update(self._fills, **discs, batched_opacities=single(np.where(alarmed, _ALARM, _FILL)))
        if self._rims:
            update(self._rims, **discs)
        around = np.where(alarmed, np.maximum(1.5 * self._radii, 2.2 * sizes), HIDDEN)
        hidden = np.where(alarmed[:, None], positions, 0.0)
        update(self._halos, batched_positions=single(hidden), batched_scales=single(around))
        badges = np.where(picture.liars, _BADGE * sizes, HIDDEN)
        above = positions + single(np.outer(badges, [0.0, 0.0, 2.0]))  # of the body, which is flat
        update(self._liars, batched_positions=above, batched_scales=single(badges))
        if self._shadows:
            ground = np.column_stack([positions[:, :2], np.full(len(positions), self._floor)])
            update(
                self._shadows,
                batched_positions=single(ground),
                batched_scales=single(0.7 * sizes),
            )

    def on_click(self, clicked: Callable[[Click], None]) -> None:
        """Call `clicked` when a body is clicked."""
        self._bodies.on_click(in_loop(clicked))
