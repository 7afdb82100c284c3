"""Shapes as vertices and faces, for swarms in the plane and in space."""

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mesh = tuple[Array, Array]
"""Vertices and faces."""


def body(flat: bool, size: float) -> Mesh:
    """An arrowhead along +x."""
    if flat:
        return _flat_arrowhead(size)
    cone = trimesh.creation.cone(radius=0.55 * size, height=1.6 * size, sections=12)
    along_x = np.asarray(cone.vertices)[:, [2, 1, 0]] * [1.0, 1.0, -1.0]
    return along_x - [0.6 * size, 0.0, 0.0], np.asarray(cone.faces)


def ball(flat: bool, radius: float) -> Mesh:
    """A sphere, or a thin disc in the plane."""
    mesh = (
        trimesh.creation.cylinder(radius=radius, height=0.02 * radius, sections=48)
        if flat
        else trimesh.creation.icosphere(subdivisions=2, radius=radius)
    )
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def ring(size: float) -> Mesh:
    """A flat ring that an agent of this size fits into."""
    mesh = trimesh.creation.annulus(r_min=1.5 * size, r_max=1.7 * size, height=0.05 * size)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _flat_arrowhead(size: float) -> Mesh:
    outline = size * np.array([[1.0, 0.0], [-0.7, 0.65], [-0.35, 0.0], [-0.7, -0.65]])
    corners = [[*point, z] for z in (0.0, 0.3 * size) for point in outline]
    edges = ((0, 1), (1, 2), (2, 3), (3, 0))
    faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
    faces += [[a, b, b + 4] for a, b in edges] + [[a, b + 4, a + 4] for a, b in edges]
    return np.array(corners), np.array(faces)
