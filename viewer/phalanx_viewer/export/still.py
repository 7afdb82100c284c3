"""A picture of a run at one time, with h_tot below it, drawn without a browser."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from phalanx.files import whole_file
from phalanx.theory.arrays import Array
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.scene.colours import COLOURS, DANGER, Role
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.static import wall_panels

_GREEN, _RED, _GREY = "#22a05e", "#e11d2e", "#64748b"


def draw(replay: Replay, t: float, path: Path) -> None:
    """Write the picture at t [s] as PNG. Raises OSError."""
    model, frame = replay.model, replay.frame(t)
    picture = Picture(model, frame)
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=[3.2, 1.0])
    scene = figure.add_subplot(grid[0], projection=None if model.flat else "3d")
    _draw_scene(scene, model, picture, replay.recent_paths(t))
    worst = "; ".join(picture.unsafe_lines[:2]) or f"worst pair {picture.worst_pair_text}"
    scene.set_title(f"{model.scenario.name}, t = {frame.t:.3f} s; {worst}", wrap=True)
    marks = [
        Line2D([], [], marker="o", linestyle="", color=np.array(COLOURS[role]) / 255.0, label=role)
        for role in Role
        if role in picture.roles
    ]
    scene.legend(handles=marks, loc="upper left", fontsize="small")
    h_tot = figure.add_subplot(grid[1])
    h_tot.plot(replay.times, replay.history.h_tot, color="#2563eb", linewidth=1.0)
    h_tot.plot(replay.times, replay.history.h, color="#0f172a", linewidth=0.8)
    h_tot.axhline(0.0, color="#94a3b8", linestyle="--")
    h_tot.axvline(frame.t, color="#0f172a", linewidth=1.0)
    h_tot.set(xlabel="t [s]", ylabel="h_tot; black: largest h")
    with whole_file(path) as part:
        figure.savefig(part, dpi=150)


def _draw_scene(axes: Any, model: SceneModel, picture: Picture, past: Array) -> None:
    static, flat, d = model.static, model.flat, 2 if model.flat else 3
    axes.plot(*static.path.T[:d], color=_GREEN, linewidth=1.5)
    for of_agent in past.swapaxes(0, 1):
        axes.plot(*of_agent.T[:d], color="#cbd5e1", linewidth=1.0)
    for line in static.outlines:
        axes.plot(*line.T[:d], color=_GREY, linewidth=3.0 if flat else 1.5)
    (_draw_in_plane if flat else _draw_in_space)(axes, model, picture)
    axes.scatter(*picture.positions.T[:d], c=picture.colours / 255.0, s=26.0, zorder=3)
    axes.set(**{f"{axis}label": f"{axis} [m]" for axis in "xyz"[:d]})


def _draw_in_plane(axes: Any, model: SceneModel, picture: Picture) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    for center, radius in model.static.spheres:
        axes.add_patch(Circle(tuple(center[:2]), radius, color=_GREY))
    for point, normal in model.static.walls:
        along = point[:2] + np.array([-normal[1], normal[0]])
        axes.axline(point[:2], along, color=_GREY, linewidth=3.0)
    colours = np.where(picture.unsafe_agents[:, None], DANGER, picture.colours) / 255.0
    for position, colour, unsafe in zip(
        picture.positions, colours, picture.unsafe_agents, strict=True
    ):
        circle = tuple(position[:2]), model.radius
        axes.add_patch(Circle(*circle, color=colour, alpha=0.6 if unsafe else 0.2))
    axes.plot(*np.array(picture.worst_pair).T[:2], color=_GREEN, linewidth=2.0)
    x, y, _ = picture.positions.T
    for arrows, colour in ((picture.u_nom, "#a0aec0"), (picture.applied, "#1e293b")):
        if arrows.any():  # else matplotlib divides by their mean length, 0
            axes.quiver(x, y, *arrows.T[:2], color=colour, angles="xy", width=0.002)
    for name, position in zip(model.names, picture.positions, strict=True):
        axes.annotate(name, position[:2], xytext=(6, 6), textcoords="offset points")


def _draw_in_space(axes: Any, model: SceneModel, picture: Picture) -> None:
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    for center, radius in model.static.spheres:
        axes.plot_surface(*(center[:, None, None] + radius * ball), color=_GREY, alpha=0.4)
    low, high = model.extent
    for corners, _ in wall_panels(model, (low + high) / 2.0, float((high - low).max()) / 2.0):
        axes.add_collection3d(Poly3DCollection([corners], color=_GREY, alpha=0.25))
    for ends in (np.array(picture.worst_pair), *picture.unsafe_ends):
        axes.plot(*ends.T, color=_RED if picture.unsafe else _GREEN, linewidth=2.0)
    for name, position in zip(model.names, picture.positions, strict=True):
        axes.text(*position, name)
    axes.set_aspect("equal")
