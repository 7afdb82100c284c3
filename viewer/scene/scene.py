"""The 3-D scene: batched nodes, so that a frame costs the same few messages for any swarm."""

from collections.abc import Callable
from typing import Final

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import Picture

Array = NDArray[np.float64]

_LABELLED = 24
"""Up to how many agents every one has its name beside it; a label is a node of its own."""
_GREY, _GREEN, _AMBER, _RED = (148, 163, 184), (34, 160, 94), (245, 158, 11), (220, 38, 38)
_PIXELS: Final = "screen"
"""The unit of lines' thickness."""
_APPLIED, _WANTED = (30, 41, 59), (160, 174, 192)


class Scene:
    """Draws pictures; knows nothing of where they come from."""

    def __init__(
        self, server: viser.ViserServer, cast: SceneModel, select: Callable[[int], None]
    ) -> None:
        """Draw what never moves.

        Args:
            server: to draw on.
            cast: what there is.
            select: called with an agent's index when it is clicked.
        """
        self._server, self._cast = server, cast
        self._size = cast.body
        self._place(self._extent())
        self._draw_still_life()
        n = len(cast.names)
        zeros, upright = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        scene = server.scene
        self._bodies = scene.add_batched_meshes_simple(
            "/agents/bodies",
            *_body(cast.flat, self._size),
            batched_wxyzs=upright,
            batched_positions=zeros,
            lod="off",
            flat_shading=True,
        )
        self._margins = scene.add_batched_meshes_simple(
            "/agents/safety radius",
            *_ball(cast.flat, max(cast.radius, 1e-3)),
            batched_wxyzs=upright,
            batched_positions=zeros,
            opacity=0.3,
            lod="off",
            cast_shadow=False,
            visible=cast.radius > 0.0,
        )
        pairs = np.zeros((n, 2, 3))
        self._applied, self._wanted = (
            scene.add_arrows(
                f"/arrows/{name}",
                pairs,
                colour,
                shaft_radius=0.09 * self._size,
                head_radius=0.22 * self._size,
                head_length=0.4 * self._size,
            )
            for name, colour in (("applied", _APPLIED), ("nominal", _WANTED))
        )
        self._trails = scene.add_line_segments(
            "/trails", pairs[:1], _GREY, thickness=1.5, thickness_units="screen"
        )
        self._closest = scene.add_line_segments(
            "/closest pair", pairs[:1], _GREEN, thickness=3.0, thickness_units="screen"
        )
        self._closest_label = scene.add_label("/closest pair/text", "", anchor="bottom-center")
        self._trouble = scene.add_line_segments(
            "/links", pairs[:1], _AMBER, thickness=1.0, thickness_units="screen"
        )
        self._goals = scene.add_point_cloud(
            "/formation/goals", np.zeros((1, 3)), _GREEN, point_size=0.3 * self._size,
            point_shape="circle", visible=cast.scenario.formation is not None,
        )  # fmt: skip
        self._ring = scene.add_mesh_simple(
            "/selected", *_ring(self._size), color=(15, 23, 42), visible=False
        )
        shown = cast.names if n <= _LABELLED else ()
        self._labels = [
            scene.add_label(f"/agents/names/{name}", name, anchor="bottom-left") for name in shown
        ]
        self._selected_label = scene.add_label("/selected/name", "", visible=False)
        self._followed_from: Array | None = None
        self.follow = False
        """Whether the cameras move with the selected agent."""
        self._last: Picture | None = None
        self._bodies.on_click(lambda event: select(self._nearest(event)))

    def show(self, picture: Picture, selected: int | None) -> None:
        """Draw a picture."""
        with self._server.atomic():
            self._show_agents(picture)
            self._show_pairs(picture)
            self._show_selected(picture, selected)
        if self.follow and selected is not None:
            self._move_cameras(picture.positions[selected])
        else:
            self._followed_from = None
        self._last = picture

    def show_past(self, positions: Array) -> None:
        """Draw trails through past positions, shape (s, N, 3)."""
        if len(positions) > 1:
            past = positions.astype(np.float32)
            self._trails.points = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)

    def show_arrows(self, visible: bool) -> None:
        """Applied and nominal inputs."""
        self._applied.visible = self._wanted.visible = visible

    def show_trails(self, visible: bool) -> None:
        """Where agents were."""
        self._trails.visible = visible

    def show_links(self, visible: bool) -> None:
        """Links that lost or delayed a broadcast."""
        self._trouble.visible = visible

    def _show_agents(self, picture: Picture) -> None:
        positions, colours = picture.positions, picture.colours
        self._bodies.batched_positions = positions.astype(np.float32)
        self._bodies.batched_wxyzs = facing(picture.headings).astype(np.float32)
        self._bodies.batched_colors = colours
        self._margins.batched_positions = positions.astype(np.float32)
        self._margins.batched_colors = colours
        for label, position in zip(self._labels, positions, strict=False):
            label.position = tuple(position)
        lifted = positions + np.array([0.0, 0.0, 0.6 * self._size])
        scale = 2.5 * self._size / max(1.0, float(np.linalg.norm(picture.u_nom, axis=1).max()))
        self._applied.points = _arrows(lifted, picture.applied * scale)
        self._wanted.points = _arrows(lifted, picture.u_nom * scale)
        if len(picture.goals):
            self._goals.points = picture.goals.astype(np.float32)

    def _show_pairs(self, picture: Picture) -> None:
        a, b = picture.closest
        self._closest.points = np.array([[a, b]], dtype=np.float32)
        self._closest_label.text = picture.closest_text
        up = np.array([0.0, 1.0, 0.0] if self._cast.flat else [0.0, 0.0, 1.0])
        self._closest_label.position = tuple((a + b) / 2.0 + 2.0 * self._size * up)
        lost = picture.trouble_lost[:, None, None]
        colours = np.where(lost, np.array(_RED), np.array(_AMBER)).astype(np.uint8)
        none = not len(picture.trouble)
        self._trouble.points = (
            np.zeros((1, 2, 3), np.float32) if none else picture.trouble.astype(np.float32)
        )
        self._trouble.colors = (
            np.zeros((1, 2, 3), np.uint8) if none else np.repeat(colours, 2, axis=1)
        )

    def _show_selected(self, picture: Picture, selected: int | None) -> None:
        self._ring.visible = selected is not None
        self._selected_label.visible = selected is not None and not self._labels
        if selected is not None:
            self._ring.position = tuple(picture.positions[selected])
            self._selected_label.text = self._cast.names[selected]

    def _move_cameras(self, target: Array) -> None:
        if self._followed_from is not None:
            for client in self._server.get_clients().values():
                client.camera.position = client.camera.position + target - self._followed_from
        self._followed_from = target.copy()

    def _nearest(self, event: "viser.SceneNodePointerEvent[viser.BatchedMeshHandle]") -> int:
        """The agent nearest to the ray of a click."""
        if event.instance_index is not None:
            return event.instance_index
        if self._last is None:
            return 0
        offsets = self._last.positions - np.array(event.ray_origin)
        direction = np.array(event.ray_direction)
        along = offsets @ direction
        return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())

    def _extent(self) -> tuple[Array, Array]:
        start = self._cast.places(self._cast.swarm.start()).positions
        points = [start, self._cast.path, *(c[None] for c, _ in self._cast.obstacles)]
        known = np.concatenate(points)
        reach = 4.0 * self._size
        return known.min(axis=0) - reach, known.max(axis=0) + reach

    def _place(self, extent: tuple[Array, Array]) -> None:
        """Put the camera where everything is in sight: above the plane, or at a slant."""
        low, high = extent
        middle, span = (low + high) / 2.0, float((high - low)[:2].max())
        camera, scene = self._server.initial_camera, self._server.scene
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_fog(1.0, 2.0, enabled=False)
        scene.set_up_direction("+y" if self._cast.flat else "+z")
        if self._cast.flat:
            camera.up, camera.fov = (0.0, 1.0, 0.0), 0.35
            camera.position = (middle[0], middle[1], 4.0 * span)
            middle = np.array([middle[0], middle[1], 0.0])
        else:
            camera.up = (0.0, 0.0, 1.0)
            camera.position = tuple(middle + span * np.array([-0.55, -0.75, 0.6]))
        camera.look_at = tuple(middle)
        floor = 0.0 if self._cast.flat else float(low[2])
        scene.add_grid(
            "/grid", width=2.0 * span, height=2.0 * span, plane="xy",
            position=(middle[0], middle[1], floor - 0.02 * self._size), cell_size=1.0,
            section_size=10.0, cell_color=(233, 236, 240), section_color=(210, 215, 222),
        )  # fmt: skip

    def _draw_still_life(self) -> None:
        scene, cast = self._server.scene, self._cast
        for number, (center, radius) in enumerate(cast.obstacles):
            scene.add_mesh_simple(
                f"/obstacles/{number}", *_ball(cast.flat, radius), color=(100, 116, 139),
                position=tuple(center), opacity=None if cast.flat else 0.6,
            )  # fmt: skip
        low, high = self._extent()
        reach = 2.0 * float((high - low).max())
        for number, (point, normal) in enumerate(cast.walls):
            thick = 0.3 * self._size
            scene.add_box(
                f"/obstacles/wall {number}", color=(100, 116, 139), opacity=0.6,
                dimensions=(thick, reach, thick if cast.flat else reach),
                wxyz=tuple(facing(normal[None])[0]), position=tuple(point + thick / 2.0 * normal),
            )  # fmt: skip
        if len(cast.path):
            segments = np.stack([cast.path[:-1], cast.path[1:]], axis=1)
            scene.add_line_segments(
                "/formation/path", segments, _GREEN, thickness=2.0, thickness_units="screen"
            )


def facing(headings: Array) -> Array:
    """Quaternions, shape (N, 4), that turn +x to unit headings, shape (N, 3); zero: no turn."""
    x, y, z = headings.T
    # Half-way between +x and the heading; straight behind, turn about z.
    half = np.stack([1.0 + x, np.zeros_like(x), -z, y], axis=1)
    behind = x < -1.0 + 1e-9
    half[behind] = [0.0, 0.0, 0.0, 1.0]
    quaternions: Array = half / np.linalg.norm(half, axis=1, keepdims=True)
    return quaternions


def _arrows(positions: Array, vectors: Array) -> NDArray[np.float32]:
    return np.stack([positions, positions + vectors], axis=1).astype(np.float32)


def _body(flat: bool, size: float) -> tuple[Array, Array]:
    """An arrowhead along +x: vertices and faces."""
    if flat:
        outline = size * np.array([[1.0, 0.0], [-0.7, 0.65], [-0.35, 0.0], [-0.7, -0.65]])
        corners = [[*point, z] for z in (0.0, 0.3 * size) for point in outline]
        edges = ((0, 1), (1, 2), (2, 3), (3, 0))
        faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
        faces += [[a, b, b + 4] for a, b in edges] + [[a, b + 4, a + 4] for a, b in edges]
        return np.array(corners), np.array(faces)
    cone = trimesh.creation.cone(radius=0.55 * size, height=1.6 * size, sections=12)
    along_x = np.asarray(cone.vertices)[:, [2, 1, 0]] * [1.0, 1.0, -1.0]
    return along_x - [0.6 * size, 0.0, 0.0], np.asarray(cone.faces)


def _ball(flat: bool, radius: float) -> tuple[Array, Array]:
    """A sphere, or a thin disc in the plane: vertices and faces."""
    mesh = (
        trimesh.creation.cylinder(radius=radius, height=0.02 * radius, sections=48)
        if flat
        else trimesh.creation.icosphere(subdivisions=2, radius=radius)
    )
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _ring(size: float) -> tuple[Array, Array]:
    ring = trimesh.creation.annulus(r_min=1.5 * size, r_max=1.7 * size, height=0.05 * size)
    return np.asarray(ring.vertices), np.asarray(ring.faces)
