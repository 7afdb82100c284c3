"""What stands still: obstacles, and walls and limits as fences around where one may be."""

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx.viewer.scene.fences import panel
from phalanx.viewer.scene.meshes import ball, polygon
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.palette import OBSTACLE

_RAIL = 4.0
"""Thickness of a fence [pixels]."""
_HATCHES = 40
"""Strokes along a fence of the scene's length: they point to where nobody may be."""


def draw_obstacles(scene: viser.SceneApi, model: SceneModel, middle: Array, reach: float) -> None:
    """Draw them once; walls reach so far [m] from the scene's middle, shape (3,)."""
    _draw_spheres(scene, model)
    for number, line in enumerate(model.surroundings.outlines):
        rail = np.stack([line[:-1], line[1:]], axis=1)
        _draw_lines(scene, f"/limits/{number}", rail, _RAIL)
    walls = [(normal, float(normal @ point)) for point, normal in model.surroundings.walls]
    for number, wall in enumerate(walls):
        others = [other for other in walls if other is not wall]
        corners = panel(wall, others, middle, reach)
        if len(corners) < 3:  # the others leave no room for it
            continue
        if model.flat:
            _draw_fence(scene, number, corners, wall[0], 2.0 * reach / _HATCHES)
        else:
            scene.add_mesh_simple(
                f"/obstacles/wall {number}", *polygon(corners), color=OBSTACLE, opacity=0.25,
                side="double", cast_shadow=False,
            )  # fmt: skip


def _draw_spheres(scene: viser.SceneApi, model: SceneModel) -> None:
    spheres = model.surroundings.spheres
    if not spheres:
        return
    scene.add_batched_meshes_simple(
        "/obstacles/spheres", *ball(model.flat),
        batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(spheres), 1)),
        batched_positions=np.array([center for center, _ in spheres]),
        batched_scales=np.array([radius for _, radius in spheres]),
        batched_colors=OBSTACLE, lod="off", cast_shadow=False,
    )  # fmt: skip


def _draw_fence(
    scene: viser.SceneApi, number: int, corners: Array, normal: Array, step: float
) -> None:
    """The line where the panel meets the plane, hatched on its far side."""
    along = np.cross([0.0, 0.0, 1.0], normal)
    places = corners @ along
    begin, end = (corners[k] * [1.0, 1.0, 0.0] for k in (places.argmin(), places.argmax()))
    steps = max(int(np.linalg.norm(end - begin) / step), 1)
    feet = begin + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - begin)
    hatches = np.stack([feet, feet + 0.7 * step * (normal - along)], axis=1)
    _draw_lines(scene, f"/obstacles/wall {number}/rail", np.array([[begin, end]]), _RAIL)
    _draw_lines(scene, f"/obstacles/wall {number}/hatches", hatches, 1.5)


def _draw_lines(scene: viser.SceneApi, name: str, segments: Array, pixels: float) -> None:
    scene.add_line_segments(name, segments, OBSTACLE, thickness=pixels, thickness_units="screen")
