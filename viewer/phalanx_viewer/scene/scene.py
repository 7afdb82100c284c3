"""The 3-D scene: draws one picture after another."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from phalanx.recording.curves.beliefs import Belief
from phalanx.theory.arrays import Array
from phalanx_viewer.scene import agents
from phalanx_viewer.scene.cameras import Camera, Framing, View
from phalanx_viewer.scene.colours import DARK, LIGHT
from phalanx_viewer.scene.ghosts import GhostNodes
from phalanx_viewer.scene.legend import BELIEFS, Mark
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import in_loop
from phalanx_viewer.scene.static import StaticNodes
from phalanx_viewer.scene.texts import LabelNodes, Panel, banner, markup

_REACH = 3.0
"""Radius around a position that is shown, in bodies."""
_READABLE, _READABLE_OF_MANY = 0.027, 0.01
"""Smallest size of a body, in the shorter side of the picture."""


class Scene:
    """Draws pictures, whatever feed they come from, on one visitor's page or into a file."""

    def __init__(
        self,
        to: viser.ViserServer | viser.ClientHandle,
        model: SceneModel,
        select: Callable[[int], None],
    ) -> None:
        """Draw the static part; `select` is called with the index of an agent that is clicked.

        to: the visitor; or a server without visitors, which writes the file.
        """
        self._model, self._select = model, select
        self._static = StaticNodes(to.scene, model, LIGHT)
        self.agents = agents.AgentNodes(to.scene, model)
        self.arrows = agents.ArrowNodes(to.scene, LIGHT)
        self.lines = agents.LineNodes(to.scene, model, LIGHT)
        self.ghosts = GhostNodes(to.scene, model, LIGHT)
        self.labels = LabelNodes(to.scene, model)
        self.banner = Panel(to.gui, markup(), order=-1.0)
        self.selection = agents.SelectionNodes(to.scene, LIGHT)
        client = to if isinstance(to, viser.ClientHandle) else None
        self.camera = Camera(client, _direction(model.flat), _REACH * model.body, model.corners)
        self.hidden = {Mark.LATE, Mark.LOST}
        """Marks whose nodes are hidden."""
        self.stale = False
        """True if the visitor came or moved the camera since the last picture."""
        self._positions: Array | None = None
        self._pose: tuple[float, ...] = ()
        """The last camera pose and size of the picture."""
        self.agents.on_click(self._on_click)
        if client is not None:
            client.camera.on_update(in_loop(self._on_camera))

    def expect(self, trajectory: Array) -> None:
        """Show all of a run: its positions, shape (s, N, 3)."""
        self.camera.expect(trajectory.reshape(-1, 3))
        self.camera.keep(Framing.RUN)

    def show(self, picture: Picture, selected: int | None, beliefs: Sequence[Belief] = ()) -> None:
        """Draw a picture; beliefs: those of the selected agent."""
        self.stale = False
        positions, model = picture.positions, self._model
        view = self.camera.show(positions, selected)
        readable = _READABLE_OF_MANY if model.crowded else _READABLE
        readable *= min(view.enlargement, 2.0)
        # In thousandths of a body: sizes that differ by rounding alone would be sent again.
        bodies = np.round(readable * view.spans(positions) / model.body, 3)
        sizes = model.body * np.maximum(bodies, 1.0)
        self.agents.show(picture, sizes)
        self.arrows.show(picture, float(np.median(sizes)))
        self.lines.show(picture, selected)
        self.ghosts.show(beliefs, positions, selected, float(np.median(sizes)))
        self.labels.show(picture, selected, sizes, view)
        self.banner.show(banner(picture.unsafe_lines, picture.past_lines))
        self.selection.show(positions, selected, sizes)
        self._positions = positions

    def set_dark(self, dark: bool) -> None:
        """Use the colours of a dark page, or of a light one."""
        palette = DARK if dark else LIGHT
        for part in (self._static, self.arrows, self.lines, self.ghosts, self.selection):
            part.set_palette(palette)
        self.stale = True

    def _on_camera(self, camera: viser.CameraHandle) -> None:
        pose = (*camera.position, *camera.look_at, camera.image_width, camera.image_height)
        self.stale, self._pose = self.stale or pose != self._pose, pose

    def _on_click(self, event: agents.Click) -> None:
        if event.instance_index is not None:
            self._select(event.instance_index)
        elif self._positions is not None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self._select(agents.nearest_to_ray(self._positions, *ray))


def begin_with(server: viser.ViserServer, model: SceneModel, positions: Array) -> None:
    """Make pages, and a file, begin with a view of positions of a run, shape (s, 3)."""
    first = _direction(model.flat).fitted(positions, _REACH * model.body)
    server.scene.set_up_direction(first.up)  # a browser that is sent this later begins again
    camera = server.initial_camera
    camera.up, camera.fov = tuple(first.up), first.fov
    camera.near, camera.far = 1e-3 * first.distance, 1e2 * first.distance
    camera.position, camera.look_at = tuple(first.position), tuple(first.look_at)


def _direction(flat: bool) -> View:
    """First view: above a plane, from far away so that nothing tilts; in space at a slant."""
    slant = [0.0, 0.0, 1.0] if flat else [-0.55, -0.75, 0.6]
    up = [0.0, 1.0, 0.0] if flat else [0.0, 0.0, 1.0]
    fov = 0.35 if flat else 0.8
    return View(np.array(slant), np.zeros(3), np.array(up), fov, aspect=1.0)


def add_display(gui: viser.GuiApi, scene: Scene, model: SceneModel) -> None:
    """Add the folder of display options to the panel."""
    framings = tuple(framing.value for framing in Framing)
    with gui.add_folder("Display", order=85, expand_by_default=False):
        framing = gui.add_dropdown("Keep in sight", framings, initial_value=scene.camera.framing)
        fit = gui.add_button("Fit the view")
        arrows = gui.add_checkbox("Inputs", True)
        paths = gui.add_checkbox("Recent paths", True)
        goals = gui.add_checkbox("Goals", True)
        links = gui.add_checkbox("Late and lost links", False)
        beliefs = gui.add_checkbox("Beliefs by radio", True, visible=model.swarm.by_radio)
        dark = gui.add_checkbox("Dark", False)

    def keep(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # viser also calls back when the scene sets the value
            scene.camera.keep(Framing(framing.value))
            scene.stale = True

    def set_dark(_: object) -> None:
        gui.configure_theme(
            dark_mode=dark.value, show_logo=False, show_share_button=False, control_width="medium"
        )
        scene.set_dark(dark.value)

    def switch(
        box: viser.GuiCheckboxHandle, marks: set[Mark], *nodes: viser.SceneNodeHandle
    ) -> None:
        def show(_: object) -> None:
            scene.hidden = scene.hidden - marks if box.value else scene.hidden | marks
            for node in nodes:
                node.visible = box.value

        box.on_update(in_loop(show))

    scene.camera.on_keep = lambda chosen: setattr(framing, "value", chosen.value)
    framing.on_update(in_loop(keep))
    fit.on_click(in_loop(keep))
    dark.on_update(in_loop(set_dark))
    switch(arrows, {Mark.APPLIED, Mark.NOMINAL}, scene.arrows.applied, scene.arrows.u_nom)
    switch(paths, {Mark.PATH}, scene.lines.paths)
    switch(goals, {Mark.GOAL}, scene.agents.goals)
    switch(links, {Mark.LATE, Mark.LOST}, scene.lines.links)
    switch(beliefs, BELIEFS, *scene.ghosts.nodes)
