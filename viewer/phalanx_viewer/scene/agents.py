"""Moving nodes of the scene: agents, inputs, selection, and lines between and behind agents."""

from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.theory.arrays import Array
from phalanx_viewer.scene.colours import DANGER, LATE, LIE, WORST_PAIR, Colour, Palette
from phalanx_viewer.scene.model import SceneModel, rotations_to
from phalanx_viewer.scene.nodes import (
    HIDDEN,
    add_batch,
    ball,
    body,
    disc,
    linear,
    move,
    ring,
    single,
    update,
)
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
_NOTHING = np.zeros((1, 2, 3))
"""A line without length, for a node with nothing to show."""


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
        p, colours, unsafe = single(picture.positions), picture.colours, picture.unsafe_agents
        turns, fills = rotations_to(picture.headings), np.where(unsafe, _UNSAFE_FILL, _FILL)
        move(self._bodies, p, sizes, wxyzs=single(turns), colors=colours)
        marked = np.where(unsafe[:, None], _RED, colours)
        move(self._fills, p, self._radii, colors=marked, opacities=single(fills))
        if self._rims:
            move(self._rims, p, self._radii, colors=marked)
        halos = np.where(unsafe, np.maximum(1.5 * self._radii, 2.2 * sizes), HIDDEN)
        move(self._halos, np.where(unsafe[:, None], p, 0.0), halos)
        rings = np.where(picture.liars, _LIE_RADIUS * sizes, HIDDEN)
        above = p + single(np.outer(rings, [0.0, 0.0, 2.0]))  # the body, which is flat
        move(self._liars, above, rings)
        has_goal = np.isfinite(picture.goals[:, :1])
        goals = np.where(has_goal[:, 0], _GOAL_RADIUS * sizes, HIDDEN)
        move(self.goals, np.where(has_goal, picture.goals, 0.0), goals, colors=colours)
        if self._shadows:
            ground = np.column_stack([p[:, :2], np.full(len(p), self._floor)])
            move(self._shadows, ground, 0.7 * sizes)

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
            visible = lengths > _HEAD * size
            cut = np.minimum(1.0, _LONGEST * size / lengths[visible])
            tails = picture.positions[visible] + [0.0, 0.0, height]
            heads = tails + cut[:, None] * vectors[visible]
            arrows.points = single(np.stack([tails, heads], axis=1))
            widths = {"shaft_radius": 0.08 * size, "head_radius": 0.2 * size}
            update(arrows, head_length=_HEAD * size, **widths)

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


class LineNodes:
    """Nodes for lines, one for each kind; each is redrawn as a whole."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        self._model, self._palette = model, palette
        # viser needs a colour for each end from the start, if the node shall ever have them.
        self.paths = lines(scene, "/recent paths", np.tile(palette.faint, (1, 2, 1)), 2.0)
        self._drops = lines(scene, "/ground/drops", self._of_drops(palette), 1.0)
        self._worst_pair = lines(scene, "/worst pair", WORST_PAIR, 3.0)
        self._unsafe = lines(scene, "/unsafe pairs", DANGER, 6.0)
        self.links = lines(scene, "/links", np.tile(LATE, (1, 2, 1)), 1.5)
        self.links.visible = False
        self._colours = np.tile(palette.faint, (len(model.names), 1))
        self._past = np.zeros((0, len(model.names), 3))

    def show(self, picture: Picture, selected: int | None) -> None:
        """Redraw pairs and link events; with many agents, events of the selected agent alone."""
        self._colours = picture.colours
        self._worst_pair.points = single(np.array([picture.worst_pair]))
        unsafe = picture.unsafe_ends if picture.unsafe else _NOTHING
        update(self._unsafe, points=single(unsafe))
        if not self._model.flat:
            p = picture.positions
            ground = np.column_stack([p[:, :2], np.full(len(p), self._model.floor)])
            self._drops.points = single(np.stack([p, ground], axis=1))
        links, colours = _NOTHING, np.zeros((1, 2, 3))
        every = np.full(len(picture.lost), True)
        visible = picture.links_of(selected) if self._model.crowded else every
        if visible.any():
            links = picture.links[visible]
            colour = np.where(picture.lost[visible, None], np.array(DANGER), np.array(LATE))
            colours = np.repeat(colour[:, None], 2, axis=1)  # of both ends
        update(self.links, points=single(links), colors=linear(colours))

    def show_recent_paths(self, positions: Array) -> None:
        """Draw paths through past positions, shape (s, N, 3), in the agents' colours, fading."""
        self._past = positions
        if len(positions) > 1:
            past = single(positions)
            self.paths.points = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)
            fresh = np.linspace(0.0, 1.0, len(past))[:, None, None]
            colours = fresh * self._colours + (1.0 - fresh) * np.array(self._palette.background)
            ends = np.stack([colours[:-1], colours[1:]], axis=2).reshape(-1, 2, 3)
            # Not as linear light: in the dark scheme paths would be hardly visible.
            self.paths.colors = ends.astype(np.uint8)

    def set_palette(self, palette: Palette) -> None:
        self._palette = palette
        self._drops.colors = np.array(self._of_drops(palette), dtype=np.uint8)
        self.show_recent_paths(self._past)

    def _of_drops(self, palette: Palette) -> Colour:
        return palette.sections if self._model.crowded else palette.faint


def lines(
    scene: viser.SceneApi, name: str, colour: Colour | NDArray[np.int_], pixels: float
) -> viser.LineSegmentsHandle:
    """Add a node for lines, of one colour or a colour for each end, shape (s, 2, 3)."""
    return scene.add_line_segments(
        name, _NOTHING, colour, thickness=pixels, thickness_units="screen"
    )


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """Index of the position, of shape (N, 3), nearest to a ray of unit direction."""
    offsets = positions - origin
    along = offsets @ direction
    return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())
