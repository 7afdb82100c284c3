"""The 3-D scene: draws one picture after another."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx_viewer.scene.agents import (
    AgentNodes,
    ArrowNodes,
    Click,
    SelectionNodes,
    nearest_to_ray,
)
from phalanx_viewer.scene.backdrop import Backdrop
from phalanx_viewer.scene.cameras import Cameras, Framing
from phalanx_viewer.scene.colours import DARK, LIGHT
from phalanx_viewer.scene.labels import LabelNodes
from phalanx_viewer.scene.lines import LineNodes
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.overlay import Panel, banner, legend, markup
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import in_loop
from phalanx_viewer.scene.view import View

_READABLE, _READABLE_IN_A_CROWD = 0.027, 0.01
"""Smallest size of a body, in the shorter side of the picture."""


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
        self.banner = Panel(server.gui, markup(), order=-1.0)
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
            self.banner.show(banner(picture.alarms, picture.past_alarms))
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


def add_display(gui: viser.GuiApi, scene: Scene) -> None:
    """Add the folder to the panel that is open."""
    framings = tuple(framing.value for framing in Framing)
    with gui.add_folder("Display", order=80):
        framing = gui.add_dropdown("Keep in sight", framings, initial_value=scene.cameras.framing)
        fit = gui.add_button("Fit the view")
        arrows = gui.add_checkbox("Inputs", True)
        paths = gui.add_checkbox("Recent paths", True)
        links = gui.add_checkbox("Late and lost links", False)
        dark = gui.add_checkbox("Dark", False)

    def keep(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # viser also calls back when the scene sets the value
            scene.cameras.keep(Framing(framing.value))
            scene.stale = True

    def wear(_: object) -> None:
        gui.configure_theme(
            dark_mode=dark.value, show_logo=False, show_share_button=False, control_width="medium"
        )
        scene.set_dark(dark.value)

    scene.cameras.on_keep = lambda kept: setattr(framing, "value", kept.value)
    framing.on_update(in_loop(keep))
    fit.on_click(in_loop(keep))
    dark.on_update(in_loop(wear))
    arrows.on_update(in_loop(lambda _: scene.arrows.set_visible(arrows.value)))
    paths.on_update(in_loop(lambda _: scene.lines.set_paths_visible(paths.value)))
    links.on_update(in_loop(lambda _: scene.lines.set_links_visible(links.value)))
