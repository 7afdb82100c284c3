"""Write a recorded run to files that one can share."""

from pathlib import Path

from phalanx.viewer.export.html import document
from phalanx.viewer.export.still import draw
from phalanx.viewer.feeds.replay import open_replay


def run(
    recording: Path,
    *,
    html: Path | None = None,
    png: Path | None = None,
    at: float | None = None,
    trust: bool = False,
) -> list[Path]:
    """Write what is asked for.

    Args:
        recording: a run folder or recording file.
        html: where a self-contained page goes.
        png: where a picture goes.
        at: time of the picture [s]; by default the worst moment.
        trust: whether code that the scenario names may be imported.

    Returns:
        The files written.

    Raises:
        UnreadableRecordingError, ValueError: nothing to export. OSError: it cannot be written.
    """
    replay = open_replay(recording, trust)
    if html is not None:
        html.write_text(document(replay), encoding="utf-8")
    if png is not None:
        draw(replay, replay.worst_at if at is None else at, png)
    return [path for path in (html, png) if path is not None]
