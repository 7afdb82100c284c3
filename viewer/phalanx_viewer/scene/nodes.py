"""Nodes that show something of every agent at once, and how they are told what is new."""

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.arrays import Array
from phalanx_viewer.scene.meshes import Mesh

HIDDEN = 1e-6
"""Scale of what is not shown: a batch keeps its number of instances."""


def add_batch(
    scene: viser.SceneApi,
    name: str,
    mesh: Mesh,
    count: int,
    opacity: float | None = None,
    lit: bool = True,
) -> viser.BatchedMeshHandle:
    """A mesh in so many places, hidden at first: one message moves all of them."""
    return scene.add_batched_meshes_simple(
        name, *mesh, batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        batched_positions=np.zeros((count, 3)), batched_scales=np.full(count, HIDDEN),
        batched_colors=np.zeros((count, 3), dtype=np.uint8), opacity=opacity,
        batched_opacities=None if opacity is None else np.ones(count),
        lod="off",  # so few faces leave nothing to simplify
        flat_shading=lit, cast_shadow=False, receive_shadow=False,
    )  # fmt: skip


def update(node: object, **properties: Any) -> None:
    """Set what differs: viser would find that out too, but takes ten times as long."""
    for name, value in properties.items():
        now = getattr(node, name)
        same = np.array_equal(now, value) if isinstance(value, np.ndarray) else now == value
        if not same:
            setattr(node, name, value)


def single(values: Array) -> NDArray[np.float32]:
    """As browsers get it."""
    return values.astype(np.float32)
