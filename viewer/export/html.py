"""A run as a file to share: HTML with scene and plots that plays by itself, or a picture."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.viewer.feeds.history import thinned
from phalanx.viewer.feeds.replay import Replay, open_replay
from phalanx.viewer.page.server import choose_port, open_page
from phalanx.viewer.scene.picture import picture
from phalanx.viewer.scene.scene import Scene

Array = NDArray[np.float64]

_FRAMES = 300
"""Most frames in a file: it has to stay a small one."""
_EVERY = 1.0 / 30.0
"""Shortest time between frames [s]."""
_POINTS = 400


def run(
    recording: Path, *, html: Path | None = None, png: Path | None = None, at: float | None = None
) -> list[Path]:
    """Write what is asked for.

    Args:
        recording: a run folder or recording file.
        html: where a self-contained page goes.
        png: where a picture goes.
        at: time of the picture [s]; by default the worst moment.

    Returns:
        The files written.

    Raises:
        UnreadableRecordingError, ValueError: nothing to export. OSError: it cannot be written.
    """
    replay = open_replay(recording)
    if html is not None:
        html.write_text(page(replay), encoding="utf-8")
    if png is not None:
        from phalanx.viewer.export.still import draw

        draw(replay, replay.worst_at if at is None else at, png)
    return [path for path in (html, png) if path is not None]


def page(replay: Replay) -> str:
    """One HTML document that holds the scene, its player and the plots, and needs no network."""
    scene = _scene(replay)
    plots = files("viewer").joinpath("export.html").read_text(encoding="utf-8")
    data = json.dumps(plot_data(replay), allow_nan=False).replace("</", "<\\/")
    end = scene.rindex("</body>")
    return scene[:end] + plots.replace("/*DATA*/", data) + scene[end:]


def plot_data(replay: Replay) -> dict[str, Any]:
    """What the exported page plots, as JSON."""
    cast, history = replay.cast, replay.history
    swarm = thinned(history.swarm.rows, _POINTS)
    t = swarm[:, 0]
    levels = range(1, len(cast.swarm.chain.psi))
    summary = replay.summary
    return {
        "title": f"{cast.scenario.name}, seed {cast.scenario.seed}",
        "verdict": f"{summary.outcome}: {summary.reason}" if summary else "no verdict",
        "begin": float(replay.times[0]),
        "end": replay.end,
        "swarm": [
            _plot("h_tot (safe: at most 0)", t, swarm[:, 1], [0.0]),
            _plot("Smallest distance [m]", t, swarm[:, 2], [2.0 * cast.radius]),
            *(_plot(f"ψ_{k}", t, swarm[:, 2 + k], [0.0]) for k in levels),
        ],
        "agents": [
            {"name": name, "plots": _agent_plots(replay, i)} for i, name in enumerate(cast.names)
        ],
    }


def _agent_plots(replay: Replay, i: int) -> list[dict[str, Any]]:
    rows = thinned(replay.history.agent(i), _POINTS)
    t, backups = rows[:, 0], np.flatnonzero(rows[:, 1])
    bounds, inputs = replay.cast.bounds[i], replay.cast.swarm.members[i].dynamics.inputs
    plots = []
    for c, name in enumerate(inputs):
        guides = [] if bounds is None else [float(bounds[0][c]), float(bounds[1][c])]
        plots.append(_plot(f"{name}, backups marked", t, rows[:, 4 + c], guides, backups.tolist()))
    plots.append(_plot("Age of the oldest û [ms]", t, 1e3 * rows[:, 2], []))
    return [*plots, _plot("Control step [ms]", t, 1e3 * rows[:, 3], [])]


def _plot(
    title: str, t: Array, y: Array, guides: list[float], marks: list[int] | None = None
) -> dict[str, Any]:
    known = np.isfinite(y)
    return {
        "title": title,
        "t": np.round(t[known], 4).tolist(),
        "y": [float(f"{value:.5g}") for value in y[known]],
        "guides": guides,
        "marks": marks or [],
    }


def _scene(replay: Replay) -> str:
    """The scene with viser's player, by way of a server that nobody visits."""
    host = "127.0.0.1"
    server = open_page(host, choose_port(host, 0), replay.cast.scenario.name)
    try:
        scene = Scene(server, replay.cast, lambda _: None)
        scene.show(picture(replay.cast, replay.frame(replay.t)), None)
        film = server.get_scene_serializer()
        times = _frame_times(replay)
        for t, following in zip(times, [*times[1:], times[-1]], strict=True):
            scene.show(picture(replay.cast, replay.frame(t)), None)
            scene.show_past(replay.past(t))
            film.insert_sleep(following - t)
        return film.as_html()
    finally:
        server.stop()


def _frame_times(replay: Replay) -> list[float]:
    begin = float(replay.times[0])
    count = int(np.clip((replay.end - begin) / _EVERY, 1, _FRAMES)) + 1
    return [float(t) for t in np.linspace(begin, replay.end, count)]
