"""Figures of the agents' paths, seen from above and from the side."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from phalanx.recording.curves.history import RecordedHistory
from phalanx.report import style
from phalanx.report.safety import required_distance
from phalanx.theory.arrays import Array, Index
from phalanx.theory.safety.function import outlines
from phalanx.theory.safety.obstacles import Sphere, Wall

_PATH_POINTS = 3000
_MANY_POINTS = 400
_OF_ROLE = {"normal": "#8fb3e6", "adversary": "#e8938f"}
"""A colour for each role, where there are too many agents for a colour each."""
_MARGIN = 1.3


def paths(history: RecordedHistory) -> Figure:
    """Draw paths in the plane; for 3-D positions, seen from above and from the side."""
    planes = [(0, 1)] if history.positions.shape[2] == 2 else [(0, 1), (0, 2)]
    low, high = scene_box(history)
    width = high[0] - low[0]
    heights = [(style.WIDTH - _MARGIN) * (high[v] - low[v]) / width for _, v in planes]
    # A flat or tall scene would make a sliver or a tower of a figure.
    heights = [min(max(h, 2.5), 8.5) for h in heights]
    figure = Figure((style.WIDTH, sum(heights) + 0.5), layout="compressed", facecolor="white")
    rows = figure.subplots(len(planes), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, plane in zip(rows, planes, strict=True):
        draw_scene(axes, history, plane)
        draw_paths(axes, history, plane)
    style.legend(rows[0])
    return figure


def draw_paths(axes: Axes, history: RecordedHistory, plane: tuple[int, int]) -> None:
    """Draw the paths of all agents; of many by role, and only the worst pair's by name."""
    (_draw_roles if style.summarises(history.scenario) else _draw_agents)(axes, history, plane)


def scene_box(history: RecordedHistory) -> tuple[Array, Array]:
    """Lowest and highest coordinates of what is drawn, with a margin [m], shapes (d,)."""
    d, scenario = history.positions.shape[2], history.scenario
    extents = [
        history.positions.reshape(-1, d),
        *(np.array(line) for line in outlines(scenario.static)),
    ]
    for obstacle in scenario.obstacles:
        if isinstance(obstacle, Sphere):
            extents.append(
                np.array(obstacle.center) + np.outer([-1.0, 1.0], np.full(d, obstacle.clearance))
            )
    points = np.concatenate(extents)
    margin = 0.04 * float(np.ptp(points, axis=0).max()) + 0.5
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _kept_states(history: RecordedHistory, most: int) -> Index:
    count = len(history.times)
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _draw_agents(axes: Axes, history: RecordedHistory, plane: tuple[int, int]) -> None:
    scenario = history.scenario
    keep = _kept_states(history, _PATH_POINTS)
    radius = required_distance(scenario)
    palette = style.colours(scenario)
    at_worst = history.positions[history.worst][:, plane]
    label = f"worst, {history.times[history.worst]:.2f} s"
    axes.plot(*at_worst.T, "x", color=style.PEAK, markersize=5, label=label, zorder=3)
    for i, (name, group, _) in enumerate(scenario.roster()):
        p = history.positions[:, i][:, plane]
        label = f"{name} ({group.role})"
        axes.plot(*p[keep].T, color=palette[name], linewidth=1.3, label=label)
        axes.plot(*p[0], "o", color=palette[name], markerfacecolor="white", markersize=5)
        axes.plot(*p[-1], "s", color=palette[name], markersize=5)
        axes.annotate(name, p[-1], xytext=(6, 4), textcoords="offset points", color=palette[name])
        if radius:
            _add_circle(axes, p[-1], radius / 2, "-", palette[name])
            _add_circle(axes, p[history.worst], radius / 2, (0, (3, 1.5)), palette[name])


def _draw_roles(axes: Axes, history: RecordedHistory, plane: tuple[int, int]) -> None:
    """Draw every path in its role's colour, and the two of the worst pair where h was largest."""
    roster = list(history.scenario.roster())
    keep = _kept_states(history, _MANY_POINTS)
    paths = history.positions[keep][:, :, plane].swapaxes(0, 1)
    for role, colour in _OF_ROLE.items():
        of_role = [i for i, (_, group, _) in enumerate(roster) if group.role == role]
        if of_role:
            label = f"{len(of_role)} × {role}"
            axes.add_collection(LineCollection(list(paths[of_role]), colors=colour, linewidths=0.8))
            axes.plot(*paths[of_role, -1].T, "s", color=colour, markersize=2.5, label=label)
    at = history.worst
    for i, colour in zip(history.worst_pair, style.WORST, strict=False):
        if i < len(roster):
            p, name = history.positions[:, i][:, plane], roster[i][0]
            axes.plot(*p[keep].T, color=colour, linewidth=1.3, label=f"{name}, of the worst pair")
            axes.plot(*p[at], "x", color=style.PEAK, markersize=6, zorder=3)
            axes.annotate(name, p[at], xytext=(5, 4), textcoords="offset points", color=colour)
        else:
            other = history.swarm.safe_set.labels[i]
            axes.plot([], [], " ", label=f"{other}, of the worst pair")


def draw_scene(axes: Axes, history: RecordedHistory, plane: tuple[int, int]) -> None:
    """Draw obstacles, and the path of the formation's centre up to the last state, to scale."""
    style.style_axes(axes)
    low, high = scene_box(history)
    axes.set_aspect("equal")
    axes.set_xlim(low[plane[0]], high[plane[0]])
    axes.set_ylim(low[plane[1]], high[plane[1]])
    axes.set_xlabel(f"{'xyz'[plane[0]]} [m]")
    axes.set_ylabel(f"{'xyz'[plane[1]]} [m]")
    scenario = history.scenario
    for k, obstacle in enumerate(scenario.obstacles):
        if isinstance(obstacle, Wall):
            _draw_wall(axes, obstacle, plane)
            continue
        center = obstacle.center[plane[0]], obstacle.center[plane[1]]
        if isinstance(obstacle, Sphere):
            reach = obstacle.clearance
            axes.add_patch(Circle(center, reach, facecolor="#c9ccd1", edgecolor="#6b7078"))
        text = axes.annotate(str(k), center, ha="center", va="center", color=style.LIMIT)
        text.set_fontsize(style.SMALL)
    for line in outlines(scenario.static):
        axes.plot(*np.array(line)[:, plane].T, color="#6b7078", linewidth=1.2)
    if scenario.formation:
        times = np.linspace(0.0, history.times[-1], 200)
        path = np.array([scenario.formation.center(t).position for t in times])
        # A planar formation of agents in space runs at height 0.
        path = np.pad(path, ((0, 0), (0, history.positions.shape[2] - path.shape[1])))
        axes.plot(*path[:, plane].T, "--", color=style.MUTED, linewidth=1.2, label="formation")


def _add_circle(axes: Axes, center: Array, radius: float, dashes: object, colour: str) -> None:
    xy = center[0], center[1]
    axes.add_patch(Circle(xy, radius, fill=False, ls=dashes, lw=0.9, edgecolor=colour))


def _draw_wall(axes: Axes, wall: Wall, plane: tuple[int, int]) -> None:
    """Draw the wall's trace in the plane, unless it is parallel to it."""
    n = wall.unit_normal[list(plane)]
    if n.any():
        x, y = (wall.offset * n / float(n @ n)).tolist()
        axes.axline((x, y), (x - n[1], y + n[0]), color="#6b7078", linewidth=2.0)
