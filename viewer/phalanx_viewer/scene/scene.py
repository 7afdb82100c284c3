"""The 3-D scene: draws one picture after another."""

from collections.abc import Callable

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx_viewer.scene.agents import AgentNodes, Click
from phalanx_viewer.scene.backdrop import Backdrop
from phalanx_viewer.scene.banner import OVER_THE_SCENE, Banner
from phalanx_viewer.scene.cameras import Cameras, Framing
from phalanx_viewer.scene.colours import (
    COLOURS,
    DANGER,
    DARK,
    LATE,
    LIE,
    LIGHT,
    WORST_PAIR,
    Colour,
    Palette,
    Role,
)
from phalanx_viewer.scene.labels import LabelNodes
from phalanx_viewer.scene.lines import LineNodes
from phalanx_viewer.scene.markup import Markup, Panel, element, markup
from phalanx_viewer.scene.meshes import ring
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.nodes import single, update
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import in_loop
from phalanx_viewer.scene.view import View

_READABLE, _READABLE_IN_A_CROWD = 0.027, 0.01
"""Smallest size of a body, in the shorter side of the picture."""
_LONGEST, _HEAD = 3.5, 0.4
"""Lengths of the longest arrow and of an arrow's head, in bodies."""
_AROUND = 1.12
"""Radius of the ring, in bodies: a little less than a disc's, so that it crosses no other's."""
_LEGEND_STYLE = Markup("""<style>
.phalanx-legend { bottom: calc(var(--phx-timeline, 0px) + 10px); padding: 3px 12px;
  background: color-mix(in srgb, var(--mantine-color-body) 85%, transparent);
  color: var(--mantine-color-text); font-size: 12px; }
.phalanx-legend summary { cursor: pointer; font-weight: 600; }
.phalanx-legend div { display: flex; flex-wrap: wrap; gap: 0 1em; }
.phalanx-legend span { white-space: nowrap; }
@media (max-width: 1000px) { .phalanx-legend { font-size: 11px; line-height: 1.35; } }
@media (max-width: 576px) { .phalanx-legend { display: none; } }
</style>""")


class Scene:
    """Draws pictures; knows nothing of where they come from."""

    def __init__(
        self, server: viser.ViserServer, model: SceneModel, select: Callable[[int], None]
    ) -> None:
        """Draw what never moves.

        Args:
            server: to draw on.
            model: what there is.
            select: called with an agent's index when it is clicked.
        """
        self._server, self._model, self._select = server, model, select
        self._backdrop = Backdrop(server.scene, model, LIGHT)
        self.agents = AgentNodes(server.scene, model)
        self.arrows = ArrowNodes(server.scene, LIGHT)
        self.lines = LineNodes(server.scene, model, LIGHT)
        self.labels = LabelNodes(server.scene, model)
        self.banner = Banner(server.gui)
        Panel(server.gui, legend(), order=99.0)
        self.selection = SelectionNodes(server.scene, LIGHT)
        self.cameras = Cameras(server, _direction(model.flat), 3.0 * model.body)
        self.cameras.expect(np.stack(model.extent))
        self.stale = False
        """Whether a visitor came or moved his camera since the last picture."""
        self._positions: Array | None = None
        self._poses: dict[int, tuple[float, ...]] = {}
        """What each visitor's camera last was, and the size of his picture."""
        self.agents.on_click(self._on_click)
        server.on_client_connect(in_loop(self._on_visitor))

    def expect(self, trajectory: Array) -> None:
        """Hold all of a run in sight: its positions, shape (s, N, 3)."""
        self.cameras.expect(trajectory.reshape(-1, 3))
        self.cameras.keep(Framing.RUN)

    def show(self, picture: Picture, selected: int | None) -> None:
        """Draw a picture."""
        self.stale = False
        positions, model = picture.positions, self._model
        # One message to every page, so that no browser paints bodies of one instant and lines of
        # another.
        with self._server.atomic():
            view = self.cameras.show(positions, selected)
            readable = _READABLE_IN_A_CROWD if model.crowded else _READABLE
            readable *= min(view.smallness, 2.0)
            # In thousandths of a body: what a rounding made another size would be sent anew.
            bodies = np.round(readable * view.spans(positions) / model.body, 3)
            sizes = model.body * np.maximum(bodies, 1.0)
            self.agents.show(picture, sizes)
            self.arrows.show(picture, float(np.median(sizes)))
            self.lines.show(picture, selected)
            self.labels.show(picture, selected, sizes, view)
            self.banner.show(picture)
            self.selection.show(positions, selected, sizes)
        self._positions = positions

    def set_dark(self, dark: bool) -> None:
        """Wear the colours of a dark page, or of a light one."""
        palette = DARK if dark else LIGHT
        for part in (self._backdrop, self.arrows, self.lines, self.selection):
            part.set_palette(palette)
        self.stale = True

    def _on_visitor(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(in_loop(self._on_camera))
        self.stale = True

    def _on_camera(self, camera: viser.CameraHandle) -> None:
        pose = (*camera.position, *camera.look_at, camera.image_width, camera.image_height)
        if self._poses.get(camera.client.client_id) != pose:
            self._poses[camera.client.client_id] = pose
            self.stale = True

    def _on_click(self, event: Click) -> None:
        if event.instance_index is not None:
            self._select(event.instance_index)
        elif self._positions is not None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self._select(nearest_to_ray(self._positions, *ray))


def _direction(flat: bool) -> View:
    """From above the plane, from far away so that nothing tilts; in space at a slant."""
    slant = [0.0, 0.0, 1.0] if flat else [-0.55, -0.75, 0.6]
    up = [0.0, 1.0, 0.0] if flat else [0.0, 0.0, 1.0]
    fov = 0.35 if flat else 0.8
    return View(np.array(slant), np.zeros(3), np.array(up), fov, aspect=1.0)


class ArrowNodes:
    """One node for all applied inputs, and one for all nominal ones."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        nothing = np.zeros((0, 2, 3))
        self._applied = scene.add_arrows("/arrows/applied", nothing, palette.ink)
        self._u_nom = scene.add_arrows("/arrows/nominal", nothing, palette.faint)

    def show(self, picture: Picture, size: float) -> None:
        """Point them; size of a body [m]."""
        # Nominal inputs may be many times as large as any that can be applied: they are cut.
        longest = float(np.linalg.norm(picture.applied, axis=1).max())
        scale = _LONGEST * size / max(1.0, longest)
        # The applied input lies above the nominal one, which is often the same.
        for arrows, vectors, height in (
            (self._applied, scale * picture.applied, 0.9 * size),
            (self._u_nom, scale * picture.u_nom, 0.5 * size),
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
        """Wear the colours of a page."""
        self._applied.colors = np.array(palette.ink, dtype=np.uint8)
        self._u_nom.colors = np.array(palette.faint, dtype=np.uint8)

    def set_visible(self, visible: bool) -> None:
        """Show them, or hide them."""
        self._applied.visible = self._u_nom.visible = visible


class SelectionNodes:
    """What marks one agent."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        self._ring = scene.add_mesh_simple(
            "/selected", *ring(0.93), color=palette.ink, visible=False, cast_shadow=False
        )

    def show(self, positions: Array, selected: int | None, sizes: Array) -> None:
        """Mark an agent, or none; positions (N, 3) and sizes of the bodies (N,) in metres."""
        self._ring.visible = selected is not None
        if selected is not None:
            self._ring.position = tuple(positions[selected])
            update(self._ring, scale=_AROUND * float(sizes[selected]))

    def set_palette(self, palette: Palette) -> None:
        """Wear the colours of a page."""
        self._ring.color = palette.ink


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """The index of the position, shape (N, 3), nearest to a ray of unit direction."""
    offsets = positions - origin
    along = offsets @ direction
    return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())


def legend() -> Markup:
    """Marks of the scene and their meanings, in an element that folds."""
    marks = [_mark("▲", COLOURS[role], role) for role in Role]
    marks += [
        _mark("◉", DANGER, "unsafe: h above 0"),
        _mark("◎", LIE, "sent a false broadcast"),
        _mark("◯", (100, 116, 139), "circles touch where h = 0"),
        element("span", element("b", "◯"), " chosen agent"),
        _mark("—", WORST_PAIR, "worst pair"),
        _mark("—", LATE, "late link"),
        _mark("—", DANGER, "lost link"),
        element("span", element("b", "→"), " applied input"),
        _mark("→", (148, 163, 184), "nominal input"),
    ]
    summary = element("summary", "Legend")
    kind = "phalanx-over phalanx-legend"
    folding = element("details", summary, element("div", *marks), kind=kind, open="")
    return markup(OVER_THE_SCENE, _LEGEND_STYLE, folding)


def _mark(sign: str, colour: Colour, text: str) -> Markup:
    return element("span", element("b", sign, style=f"color:rgb{colour}"), f" {text}")
