"""The static part of the scene: ground, light, obstacles and the corridor of the formation."""

import math
from collections.abc import Iterator

import numpy as np
import viser

from phalanx.theory.arrays import Array
from phalanx_viewer.scene.colours import OBSTACLE, WORST_PAIR, Palette
from phalanx_viewer.scene.model import SceneModel, unit
from phalanx_viewer.scene.nodes import ball, polygon, ribbon

_RAIL = 4.0
"""Thickness of a fence [pixels]."""
_HATCHES = 40
"""Strokes along a fence of the scene's length, on its unsafe side."""
HalfSpace = tuple[Array, float]
"""Unit normal out of it, shape (3,), and offset [m]: n·p <= offset."""


class StaticNodes:
    """Nodes that are drawn once; only their colours change."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        low, high = model.extent
        middle, span = (low + high) / 2.0, float((high - low).max())
        # viser's own lights wash out the colours that distinguish agents.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        ambient, sun = (1.8, 0.2) if model.flat else (1.2, 1.4)
        scene.add_light_ambient("/lights/ambient", intensity=ambient)
        scene.add_light_directional("/lights/sun", intensity=sun, position=(1.0, -2.0, 4.0))
        scene.configure_fog(1.0, 2.0, enabled=False)
        cell = 10.0 ** round(math.log10(span / 20.0))
        # A little lower than what lies on the plane: two surfaces at one depth flicker.
        position = (middle[0], middle[1], model.floor - 0.02 * model.body)
        self._grid = scene.add_grid(
            "/ground/grid", plane="xy", infinite_grid=True, position=position, cell_size=cell,
            section_size=5.0 * cell, fade_distance=8.0 * span, fade_strength=2.0,
        )  # fmt: skip
        self.set_palette(palette)
        _draw_obstacles(scene, model, middle, span)
        _draw_corridor(scene, model)

    def set_palette(self, palette: Palette) -> None:
        self._grid.cell_color, self._grid.section_color = palette.cells, palette.sections


def _draw_corridor(scene: viser.SceneApi, model: SceneModel) -> None:
    """Draw the path of the formation's centre, and a corridor as wide as the formation."""
    path, width = model.static.path, model.static.corridor
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


def _draw_obstacles(scene: viser.SceneApi, model: SceneModel, middle: Array, reach: float) -> None:
    """Draw obstacles and limits; walls reach so far [m] from the scene's middle, shape (3,)."""
    static = model.static
    if static.spheres:
        centers, radii = zip(*static.spheres, strict=True)
        scene.add_batched_meshes_simple(
            "/obstacles/spheres", *ball(model.flat),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(radii), 1)),
            batched_positions=np.array(centers), batched_scales=np.array(radii),
            batched_colors=OBSTACLE, lod="off", cast_shadow=False,
        )  # fmt: skip
    for number, line in enumerate(static.outlines):
        _draw_lines(scene, f"/limits/{number}", np.stack([line[:-1], line[1:]], axis=1), _RAIL)
    for number, (corners, normal) in enumerate(wall_panels(model, middle, reach)):
        if model.flat:
            _draw_fence(scene, number, corners, normal, 2.0 * reach / _HATCHES)
        else:
            scene.add_mesh_simple(
                f"/obstacles/wall {number}", *polygon(corners), color=OBSTACLE, opacity=0.25,
                side="double", cast_shadow=False,
            )  # fmt: skip


def _draw_fence(
    scene: viser.SceneApi, number: int, corners: Array, normal: Array, step: float
) -> None:
    """Draw the line where a wall's panel meets the plane, hatched on its far side."""
    along = np.cross([0.0, 0.0, 1.0], normal)
    offsets = corners @ along
    begin, end = (corners[k] * [1.0, 1.0, 0.0] for k in (offsets.argmin(), offsets.argmax()))
    steps = max(int(np.linalg.norm(end - begin) / step), 1)
    feet = begin + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - begin)
    hatches = np.stack([feet, feet + 0.7 * step * (normal - along)], axis=1)
    _draw_lines(scene, f"/obstacles/wall {number}/rail", np.array([[begin, end]]), _RAIL)
    _draw_lines(scene, f"/obstacles/wall {number}/hatches", hatches, 1.5)


def _draw_lines(scene: viser.SceneApi, name: str, segments: Array, pixels: float) -> None:
    scene.add_line_segments(name, segments, OBSTACLE, thickness=pixels, thickness_units="screen")


def wall_panels(model: SceneModel, middle: Array, reach: float) -> Iterator[tuple[Array, Array]]:
    """Yield each wall's corners [m], shape (k, 3), and normal, shape (3,).

    None of a wall for which the others leave no room.
    """
    walls = [(normal, float(normal @ point)) for point, normal in model.static.walls]
    for wall in walls:
        others = [other for other in walls if other is not wall]
        corners = panel(wall, others, middle, reach)
        if len(corners) >= 3:
            yield corners, wall[0]


def panel(wall: HalfSpace, others: list[HalfSpace], middle: Array, reach: float) -> Array:
    """Corners of a wall's surface, shape (c, 3), where the other walls leave room for it.

    Without others it is a square around the scene's middle [m], shape (3,), of half-width `reach`.
    """
    normal, offset = wall
    foot = middle + (offset - normal @ middle) * normal
    level = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = unit(np.cross(level, normal))
    high = np.cross(normal, across)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = foot + reach * square @ np.stack([across, high])
    for other in others:
        corners = _clipped(corners, other)
    return corners


def _clipped(corners: Array, keep: HalfSpace) -> Array:
    """Clip a convex polygon to a half-space (Sutherland-Hodgman)."""
    normal, offset = keep
    beyond = corners @ normal - offset
    clipped: list[Array] = []
    for k, corner in enumerate(corners):
        last, last_beyond = corners[k - 1], beyond[k - 1]
        if (last_beyond > 0.0) != (beyond[k] > 0.0):
            clipped.append(last + last_beyond / (last_beyond - beyond[k]) * (corner - last))
        if beyond[k] <= 0.0:
            clipped.append(corner)
    return np.array(clipped).reshape(-1, 3)
