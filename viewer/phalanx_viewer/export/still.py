"""A picture of a run at one time, with h_tot below it, drawn without a browser."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from phalanx.arrays import Array
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.scene.colours import COLOURS, DANGER, Role
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.picture import Picture, picture

_GREEN, _RED = "#22a05e", "#e11d2e"


def draw(replay: Replay, t: float, path: Path) -> None:
    """Write the picture at t [s] as PNG. Raises OSError."""
    model, frame = replay.model, replay.frame(t)
    shown, past = picture(model, frame), replay.recent_paths(t)
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=[3.2, 1.0])
    scene = figure.add_subplot(grid[0], projection=None if model.flat else "3d")
    (_draw_in_plane if model.flat else _draw_in_space)(scene, model, shown, past)
    worst = "; ".join(shown.unsafe_lines[:2]) or f"worst pair {shown.worst_pair_text}"
    scene.set_title(f"{model.scenario.name}, t = {frame.t:.3f} s; {worst}", wrap=True)
    scene.legend(handles=_legend(shown), loc="upper left", fontsize="small")
    _h_tot_plot(figure.add_subplot(grid[1]), replay, frame.t)
    figure.savefig(path, dpi=150)


def _draw_in_plane(axes: Any, model: SceneModel, shown: Picture, past: Array) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.plot(*model.static.path.T[:2], color=_GREEN, linewidth=1.5)
    axes.plot(past[:, :, 0], past[:, :, 1], color="#cbd5e1", linewidth=1.0)
    for center, radius in model.static.spheres:
        axes.add_patch(Circle(tuple(center[:2]), radius, color="#64748b"))
    for point, normal in model.static.walls:
        along = point[:2] + np.array([-normal[1], normal[0]])
        axes.axline(point[:2], along, color="#64748b", linewidth=3.0)
    for line in model.static.outlines:
        axes.plot(*line.T[:2], color="#64748b", linewidth=3.0)
    colours = np.where(shown.unsafe_agents[:, None], np.array(DANGER) / 255.0, _rgb(shown))
    for position, colour, unsafe in zip(shown.positions, colours, shown.unsafe_agents, strict=True):
        circle = tuple(position[:2]), model.radius
        axes.add_patch(Circle(*circle, color=colour, alpha=0.6 if unsafe else 0.2))
    ends = np.array(shown.worst_pair)
    axes.plot(ends[:, 0], ends[:, 1], color=_GREEN, linewidth=2.0)
    x, y, _ = shown.positions.T
    axes.quiver(x, y, *shown.u_nom.T[:2], color="#a0aec0", angles="xy", width=0.002)
    axes.quiver(x, y, *shown.applied.T[:2], color="#1e293b", angles="xy", width=0.002)
    axes.scatter(x, y, c=_rgb(shown), s=26.0, zorder=3)
    for name, position in zip(model.names, shown.positions, strict=True):
        axes.annotate(name, position[:2], xytext=(6, 6), textcoords="offset points")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def _draw_in_space(axes: Any, model: SceneModel, shown: Picture, past: Array) -> None:
    axes.plot(*model.static.path.T, color=_GREEN, linewidth=1.5)
    for agent in range(past.shape[1]):
        axes.plot(*past[:, agent].T, color="#cbd5e1", linewidth=1.0)
    for center, radius in model.static.spheres:
        axes.plot_surface(*_sphere(center, radius), color="#64748b", alpha=0.4)
    for line in model.static.outlines:
        axes.plot(*line.T, color="#64748b", linewidth=1.5)
    for ends in (np.array(shown.worst_pair), *shown.unsafe_ends):
        axes.plot(*ends.T, color=_RED if shown.unsafe else _GREEN, linewidth=2.0)
    axes.scatter(*shown.positions.T, c=_rgb(shown), s=26.0)
    for name, position in zip(model.names, shown.positions, strict=True):
        axes.text(*position, name)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")


def _h_tot_plot(axes: Axes, replay: Replay, t: float) -> None:
    axes.plot(replay.times, replay.history.h_tot, color="#2563eb", linewidth=1.0)
    axes.axhline(0.0, color="#94a3b8", linestyle="--")
    axes.axvline(t, color="#0f172a", linewidth=1.0)
    axes.set_xlabel("t [s]")
    axes.set_ylabel("h_tot")


def _legend(shown: Picture) -> list[Any]:
    present = [role for role in Role if role in shown.roles]
    return [
        Line2D([], [], marker="o", linestyle="", color=np.array(COLOURS[role]) / 255.0, label=role)
        for role in present
    ]


def _rgb(shown: Picture) -> Array:
    return np.asarray(shown.colours / 255.0)


def _sphere(center: Array, radius: float) -> tuple[Array, Array, Array]:
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    x, y, z = center
    return (
        x + radius * np.cos(u) * np.sin(v),
        y + radius * np.sin(u) * np.sin(v),
        z + radius * np.cos(v),
    )
