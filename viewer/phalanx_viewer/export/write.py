"""Write a recorded run to files that one can share."""

import logging
from collections.abc import Callable
from pathlib import Path

from phalanx.recording.read import read
from phalanx_viewer.export.html import document
from phalanx_viewer.export.still import draw
from phalanx_viewer.export.tables import CSV, PARQUET, write_tables
from phalanx_viewer.feeds.replay import Replay

log = logging.getLogger("phalanx.viewer")


def run(
    recording: Path,
    *,
    html: Path | None = None,
    png: Path | None = None,
    at: float | None = None,
    mcap: Path | None = None,
    rerun: Path | None = None,
    parquet: Path | None = None,
    csv: Path | None = None,
    trust: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Write what is asked for.

    Args:
        recording: a run folder or recording file.
        html: where a self-contained page goes.
        png: where a picture goes.
        at: time of the picture [s]; by default the worst moment.
        mcap: where a recording that Foxglove shows goes.
        rerun: where one for rerun's viewer goes; needs rerun-sdk.
        parquet: folder for the run's tables, one file each.
        csv: likewise.
        trust: whether code that the scenario names may be imported.
        progress: told what is made next.

    Returns:
        The files written.

    Raises:
        UnreadableRecordingError, ValueError: nothing to export, or a time outside the run.
        OSError: it cannot be written.
    """
    progress("reading the recording")
    recorded = read(recording, trust)
    if recorded.damage:
        log.warning("%s: %s; no verdict", recorded.path, recorded.damage)
    replay = Replay(recorded)
    if at is not None and not replay.times[0] <= at <= replay.end:
        raise ValueError(f"--at: expected {replay.times[0]:g} to {replay.end:g} s, got {at:g}")
    if html is not None:
        html.write_text(document(replay, progress), encoding="utf-8")
    if png is not None:
        draw(replay, replay.worst_at if at is None else at, png)
    if mcap is not None:
        progress("messages")
        # Its libraries are for those who ask for it.
        from phalanx_viewer.export.mcap import write_mcap

        write_mcap(recorded, mcap)
    if rerun is not None:
        progress("entities")
        from phalanx_viewer.export.rerun import write_rerun

        write_rerun(recorded, rerun)
    tables = [
        written
        for kind, folder in ((PARQUET, parquet), (CSV, csv))
        if folder is not None
        for written in write_tables(recorded, replay.model.swarm, folder, kind)
    ]
    return [*(path for path in (html, png, mcap, rerun) if path is not None), *tables]
