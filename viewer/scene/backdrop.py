"""What never moves: camera, grid, obstacles and the formation's path."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.geometry import facing
from phalanx.viewer.scene.meshes import ball
from phalanx.viewer.scene.model import SceneModel

Array = NDArray[np.float64]

_SLATE, _GREEN = (100, 116, 139), (34, 160, 94)
_NARROW_VIEW = 0.35
"""The camera's field of view above the plane [rad]: from far away, so that nothing tilts."""


def draw_backdrop(server: viser.ViserServer, model: SceneModel) -> None:
    """Draw it once, with everything in the camera's sight."""
    low, high = _extent(model)
    _place_camera(server, model.flat, low, high)
    _draw_grid(server.scene, model, low, high)
    _draw_spheres(server.scene, model)
    _draw_walls(server.scene, model, 2.0 * float((high - low).max()))
    path = model.surroundings.path
    if len(path):
        segments = np.stack([path[:-1], path[1:]], axis=1)
        server.scene.add_line_segments(
            "/formation/path", segments, _GREEN, thickness=2.0, thickness_units="screen"
        )


def _extent(model: SceneModel) -> tuple[Array, Array]:
    """Opposite corners of the box that holds what is known of the run beforehand."""
    start = model.kinematics.poses(model.swarm.start()).positions
    centers = [center[None] for center, _ in model.surroundings.spheres]
    known = np.concatenate([start, model.surroundings.path, *centers])
    reach = 4.0 * model.body
    return known.min(axis=0) - reach, known.max(axis=0) + reach


def _place_camera(server: viser.ViserServer, flat: bool, low: Array, high: Array) -> None:
    """Above the plane, or at a slant."""
    middle, span = (low + high) / 2.0, float((high - low)[:2].max())
    camera, scene = server.initial_camera, server.scene
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_fog(1.0, 2.0, enabled=False)
    scene.set_up_direction("+y" if flat else "+z")
    if flat:
        camera.up, camera.fov = (0.0, 1.0, 0.0), _NARROW_VIEW
        camera.position = (middle[0], middle[1], 4.0 * span)
        camera.look_at = (middle[0], middle[1], 0.0)
    else:
        camera.up = (0.0, 0.0, 1.0)
        camera.position = tuple(middle + span * np.array([-0.55, -0.75, 0.6]))
        camera.look_at = tuple(middle)


def _draw_grid(scene: viser.SceneApi, model: SceneModel, low: Array, high: Array) -> None:
    middle, span = (low + high) / 2.0, float((high - low)[:2].max())
    floor = 0.0 if model.flat else float(low[2])
    scene.add_grid(
        "/grid", width=2.0 * span, height=2.0 * span, plane="xy",
        # A little lower than what lies on the plane: two surfaces at one depth flicker.
        position=(middle[0], middle[1], floor - 0.02 * model.body), cell_size=1.0,
        section_size=10.0, cell_color=(233, 236, 240), section_color=(210, 215, 222),
    )  # fmt: skip


def _draw_spheres(scene: viser.SceneApi, model: SceneModel) -> None:
    for number, (center, radius) in enumerate(model.surroundings.spheres):
        scene.add_mesh_simple(
            f"/obstacles/{number}", *ball(model.flat, radius), color=_SLATE,
            position=tuple(center), opacity=None if model.flat else 0.6,
        )  # fmt: skip


def _draw_walls(scene: viser.SceneApi, model: SceneModel, length: float) -> None:
    thick = 0.3 * model.body
    for number, (point, normal) in enumerate(model.surroundings.walls):
        scene.add_box(
            f"/obstacles/wall {number}", color=_SLATE, opacity=0.6,
            dimensions=(thick, length, thick if model.flat else length),
            wxyz=tuple(facing(normal[None])[0]), position=tuple(point + thick / 2.0 * normal),
        )  # fmt: skip
