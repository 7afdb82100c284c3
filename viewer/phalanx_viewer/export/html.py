"""One HTML document that holds a run's scene, its player and its plots, and needs no network."""

from collections.abc import Callable
from importlib.resources import files

import msgspec
import numpy as np

from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.plots.content import script
from phalanx_viewer.plots.plots import content
from phalanx_viewer.scene.picture import picture
from phalanx_viewer.scene.scene import Scene
from phalanx_viewer.scene.server import SceneServer

_FRAMES = 300
"""Most frames in a file, to keep it small."""
_FRAME_PERIOD = 1.0 / 30.0
"""Shortest time between frames [s]."""


def document(replay: Replay, progress: Callable[[str], None] = lambda _: None) -> str:
    """Write the document; `progress` is called with texts such as "scene, t = 1.00 of 2.00 s"."""
    scene, summary = _scene(replay, progress), replay.summary
    page = files(__package__).joinpath("player.html").read_text(encoding="utf-8")
    player = files("phalanx.compat").joinpath("viser_player.js").read_text(encoding="utf-8")
    verdict = (summary.outcome, summary.reason) if summary else ("no verdict", replay.unfinished)
    data = {
        "verdict": ": ".join(verdict),
        "content": content(replay, range(len(replay.model.names)), seekable=True),
    }
    # A tag or a comment in the data could end the element that holds them.
    shown = msgspec.json.encode(data).decode().replace("<", "\\u003c")
    end = scene.rindex("</body>")
    parts = page.replace("/*PLAYER*/", player).replace("/*SCRIPT*/", script())
    parts = parts.replace("/*DATA*/", shown)
    return scene[:end] + parts + scene[end:]


def _scene(replay: Replay, progress: Callable[[str], None]) -> str:
    """The scene as HTML, with viser's player."""
    # viser has no scene without a server, and records what that sends. This one admits no page.
    server = SceneServer("127.0.0.1", 0, replay.model.scenario.name)
    try:
        scene = Scene(server, replay.model, lambda _: None)
        scene.expect(replay.history.trajectory)
        scene.show(picture(replay.model, replay.frame(replay.t)), None)
        film = server.get_scene_serializer()
        times = _frame_times(replay)
        for t, following in zip(times, [*times[1:], times[-1]], strict=True):
            scene.show(picture(replay.model, replay.frame(t)), None)
            scene.lines.show_recent_paths(replay.recent_paths(t))
            film.insert_sleep(following - t)
            progress(f"scene, t = {t:.2f} of {replay.end:.2f} s")
        return film.as_html()
    finally:
        server.stop()


def _frame_times(replay: Replay) -> list[float]:
    begin = float(replay.times[0])
    count = int(np.clip((replay.end - begin) / _FRAME_PERIOD, 1, _FRAMES)) + 1
    return [float(t) for t in np.linspace(begin, replay.end, count)]
