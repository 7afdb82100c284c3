"""Batched nodes, one for something of every agent, and the unit meshes that they show."""

from typing import Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from phalanx.theory.arrays import Array

Floats = NDArray[np.floating[Any]]
Mesh = tuple[Array, Array]
"""Vertices and faces."""
HIDDEN = 1e-6
"""Scale of a hidden instance: a batch keeps its number of instances."""


def add_batch(
    scene: viser.SceneApi,
    name: str,
    mesh: Mesh,
    count: int,
    opacity: float | None = None,
    lit: bool = True,
) -> viser.BatchedMeshHandle:
    """Add `count` instances of a mesh, hidden at first: one message moves all of them."""
    return scene.add_batched_meshes_simple(
        name, *mesh, batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        batched_positions=np.zeros((count, 3)), batched_scales=np.full(count, HIDDEN),
        batched_colors=np.zeros((count, 3), dtype=np.uint8), opacity=opacity,
        batched_opacities=None if opacity is None else np.ones(count),
        lod="off",  # so few faces need no simplification
        flat_shading=lit, cast_shadow=False, receive_shadow=False,
    )  # fmt: skip


def update(node: object, **properties: Any) -> None:
    """Set the properties that differ: viser would compare too, but takes ten times as long."""
    for name, value in properties.items():
        now = getattr(node, name)
        same = np.array_equal(now, value) if isinstance(value, np.ndarray) else now == value
        if not same:
            setattr(node, name, value)


def move(
    node: viser.BatchedMeshHandle, positions: Floats, scales: Floats, **looks: NDArray[Any]
) -> None:
    """Move and scale the instances of a batch; looks: such as their `colors`."""
    of_batch = {f"batched_{name}": values for name, values in looks.items()}
    update(node, batched_positions=single(positions), batched_scales=single(scales), **of_batch)


def single(values: Floats) -> NDArray[np.float32]:
    """Single precision, as viser sends it to browsers."""
    return values.astype(np.float32)


def linear(colours: NDArray[Any]) -> NDArray[np.uint8]:
    """Colours of lines' ends: viser shows them as linear light, unlike all others."""
    return np.rint(255.0 * ((colours / 255.0 + 0.055) / 1.055) ** 2.4).astype(np.uint8)


def body(flat: bool) -> Mesh:
    """An arrowhead along +x."""
    if flat:
        return _flat_arrowhead()
    cone = trimesh.creation.cone(radius=0.6, height=1.8, sections=16)
    along_x = np.asarray(cone.vertices)[:, [2, 1, 0]] * [1.0, 1.0, -1.0]
    return along_x - [0.7, 0.0, 0.0], np.asarray(cone.faces)


def ball(flat: bool) -> Mesh:
    """A sphere, or a thin disc in the plane."""
    if flat:
        return disc()
    return _mesh(trimesh.creation.icosphere(subdivisions=3))


def disc() -> Mesh:
    """A thin disc, facing +z."""
    return _mesh(trimesh.creation.cylinder(radius=1.0, height=0.02, sections=64))


def ring(inner: float) -> Mesh:
    """A thin ring from an inner radius to 1, facing +z."""
    return _mesh(trimesh.creation.annulus(r_min=inner, r_max=1.0, height=0.03, sections=64))


def ribbon(path: Array, width: float) -> Mesh:
    """A level ribbon along a path, shape (s, 3)."""
    along = np.gradient(path, axis=0)
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(path))], axis=1)
    across *= width / 2.0 / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    first = 2 * np.arange(len(path) - 1)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [2, 1, 3]])).reshape(-1, 3)
    return np.stack([path - across, path + across], axis=1).reshape(-1, 3), faces


def polygon(corners: Array) -> Mesh:
    """A convex polygon, shape (c, 3), c at least 3."""
    k = np.arange(1, len(corners) - 1)
    return corners, np.stack([np.zeros_like(k), k, k + 1], axis=1)


def _mesh(mesh: trimesh.Trimesh) -> Mesh:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _flat_arrowhead() -> Mesh:
    outline = np.array([[1.0, 0.0], [-0.75, 0.7], [-0.35, 0.0], [-0.75, -0.7]])
    corners = [[*point, z] for z in (0.0, 0.3) for point in outline]
    edges = ((0, 1), (1, 2), (2, 3), (3, 0))
    faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
    faces += [[a, b, b + 4] for a, b in edges] + [[a, b + 4, a + 4] for a, b in edges]
    return np.array(corners), np.array(faces)
