"""What never moves: the ground, obstacles and the corridor of the formation."""

import math

import numpy as np
import viser

from phalanx.viewer.scene.meshes import ribbon
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.obstacles import draw_obstacles
from phalanx.viewer.scene.palette import WORST_PAIR, Palette


class Backdrop:
    """Drawn once; only its colours change."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        low, high = model.extent
        middle, span = (low + high) / 2.0, float((high - low).max())
        # viser's own lights wash out the colours by which agents are told apart.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        ambient, sun = (1.8, 0.2) if model.flat else (1.2, 1.4)
        scene.add_light_ambient("/lights/ambient", intensity=ambient)
        scene.add_light_directional("/lights/sun", intensity=sun, position=(1.0, -2.0, 4.0))
        scene.configure_fog(1.0, 2.0, enabled=False)
        scene.set_up_direction("+y" if model.flat else "+z")
        cell = 10.0 ** round(math.log10(span / 20.0))
        # A little lower than what lies on the plane: two surfaces at one depth flicker.
        position = (middle[0], middle[1], model.floor - 0.02 * model.body)
        self._grid = scene.add_grid(
            "/ground/grid", plane="xy", infinite_grid=True, position=position, cell_size=cell,
            section_size=5.0 * cell, fade_distance=8.0 * span, fade_strength=2.0,
        )  # fmt: skip
        self.set_palette(palette)
        draw_obstacles(scene, model, middle, span)
        _draw_corridor(scene, model)

    def set_palette(self, palette: Palette) -> None:
        """Wear the colours of a page."""
        self._grid.cell_color, self._grid.section_color = palette.cells, palette.sections


def _draw_corridor(scene: viser.SceneApi, model: SceneModel) -> None:
    """Where the formation is to go: its centre's path, as wide as the formation."""
    path, width = model.surroundings.path, model.surroundings.corridor
    if not len(path):
        return
    if width > 0.0 and model.flat:
        scene.add_mesh_simple(
            "/formation/corridor", *ribbon(path, width), color=WORST_PAIR, opacity=0.04,
            side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    segments = np.stack([path[:-1:2], path[1::2]], axis=1)  # every other one: a dashed line
    scene.add_line_segments(
        "/formation/path", segments, WORST_PAIR, thickness=1.5, thickness_units="screen"
    )
