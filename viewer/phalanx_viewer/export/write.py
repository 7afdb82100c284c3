"""Write a recorded run to files for sharing and for other tools."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import msgspec
import numpy as np

from phalanx.native.files import whole_file
from phalanx.recording.read import Recording
from phalanx.schema.extensions import extension
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.plots.plots import content, script
from phalanx_viewer.scene.legend import Mark
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.scene import Scene, begin_with
from phalanx_viewer.scene.server import SceneServer

_FRAMES = 300
"""Most frames in a file, to keep it small."""
_FRAME_PERIOD = 1.0 / 30.0
"""Shortest time between frames [s]."""


def run(
    recorded: Recording,
    *,
    progress: Callable[[str], None] = lambda _: None,
    **paths: Path | None,
) -> list[Path]:
    """Write every file that has a path.

    Args:
        recorded: the run.
        progress: called with the name of the next part.
        paths: of html, a self-contained page; mcap, a recording for Foxglove and others; parquet
            and csv, folders for the run's tables.

    Returns the files written. Raises OSError.
    """
    replay = Replay(recorded)
    model = replay.model
    written = []
    for kind, path in paths.items():
        if path is None:
            continue
        match kind:
            case "html":
                with whole_file(path) as part:
                    part.write_text(_document(replay, progress), encoding="utf-8")
            case "mcap":
                progress("messages")
                extension("mcap")(recorded, model, path)
            case _:
                # Tables need `lab`, a page does not.
                from phalanx_viewer.export.tables import write_tables

                written += write_tables(recorded, model.swarm, path, kind)
                continue
        written.append(path)
    return written


def _document(replay: Replay, progress: Callable[[str], None]) -> str:
    """Write the document; `progress` is called with texts such as "scene, t = 1.00 of 2.00 s"."""
    begin = float(replay.times[0])
    count = int(np.clip((replay.end - begin) / _FRAME_PERIOD, 1, _FRAMES)) + 1
    times: list[float] = np.linspace(begin, replay.end, count).tolist()
    scene, summary = _scene(replay, times, progress), replay.summary
    page = files(__package__).joinpath("player.html").read_text(encoding="utf-8")
    verdict = (summary.outcome, summary.reason) if summary else ("no verdict", replay.unfinished)
    hidden = {Mark.LATE, Mark.LOST} | ({Mark.CHOSEN} if _chosen(replay) is None else set())
    chosen = _chosen(replay) or 0
    agents = sorted(range(len(replay.model.names)), key=lambda i: i != chosen)
    data = {
        "verdict": ": ".join(verdict),
        "content": content(replay, agents, seekable=True, hidden=hidden),
        "times": times,
    }
    # A tag or a comment in the data could end the element that holds them.
    text = msgspec.json.encode(data).decode().replace("<", "\\u003c")
    end = scene.rindex("</body>")
    parts = page.replace("/*SCRIPT*/", script()).replace("/*DATA*/", text)
    return scene[:end] + parts + scene[end:]


def _scene(replay: Replay, times: list[float], progress: Callable[[str], None]) -> str:
    """The scene at these times [s] as HTML, with viser's player."""
    # viser has no scene without a server, and records what that sends. This one admits no page.
    server = SceneServer("127.0.0.1", 0, replay.model.scenario.name)
    try:
        trajectory = replay.history.trajectory
        begin_with(server, replay.model, trajectory.reshape(-1, 3))
        scene = Scene(server, replay.model, lambda _: None)
        scene.expect(trajectory)
        chosen = _chosen(replay)
        scene.show(Picture(replay.model, replay.frame(replay.t)), chosen)
        film = server.get_scene_serializer()
        # viser's player starts again at the end of a film: its last picture must stay before that.
        for t, following in zip(times, [*times[1:], times[-1] + _FRAME_PERIOD], strict=True):
            beliefs = replay.radio.at(chosen, t) if replay.radio and chosen is not None else ()
            scene.show(Picture(replay.model, replay.frame(t)), chosen, beliefs)
            scene.lines.show_recent_paths(replay.recent_paths(t))
            film.insert_sleep(following - t)
            progress(f"scene, t = {t:.2f} of {replay.end:.2f} s")
        return film.as_html()
    finally:
        server.stop()


def _chosen(replay: Replay) -> int | None:
    """Return the agent whose beliefs a film shows: by radio, one of the worst pair if it can."""
    if replay.radio is None:
        return None
    news = replay.radio.news
    return min(news, key=lambda i: (i not in replay.history.worst_pair, i))
