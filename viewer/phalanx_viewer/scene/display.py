"""The folder that says what the scene shows, and what the cameras keep in sight."""

from typing import Any

import viser

from phalanx_viewer.scene.cameras import Framing
from phalanx_viewer.scene.scene import Scene
from phalanx_viewer.scene.server import in_loop


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
