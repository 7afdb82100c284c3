"""Write a recorded run to files for sharing and for other tools."""

from collections.abc import Callable
from pathlib import Path

import polars as pl

from phalanx.metrics.table import metrics_table
from phalanx.recording.read import Recording
from phalanx.recording.tables import events_table, h_table, inputs_table, links_table, states_table
from phalanx.swarm.swarm import Swarm
from phalanx_viewer.export.html import document
from phalanx_viewer.export.still import draw
from phalanx_viewer.feeds.replay import Replay


def run(
    recorded: Recording,
    *,
    html: Path | None = None,
    png: Path | None = None,
    at: float | None = None,
    mcap: Path | None = None,
    rerun: Path | None = None,
    parquet: Path | None = None,
    csv: Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Write every file that has a path.

    Args:
        recorded: the run.
        html: a self-contained page.
        png: a picture.
        at: time of the picture [s]; by default the worst moment.
        mcap: a recording for Foxglove.
        rerun: a recording for rerun's viewer; needs rerun-sdk.
        parquet: folder for the run's tables, one file each.
        csv: the same as CSV.
        progress: called with the name of the next part.

    Returns the files written. Raises OSError, and ValueError for a time outside the run.
    """
    replay = Replay(recorded)
    if at is not None and not replay.times[0] <= at <= replay.end:
        raise ValueError(f"--at: expected {replay.times[0]:g} to {replay.end:g} s, got {at:g}")
    if html is not None:
        html.write_text(document(replay, progress), encoding="utf-8")
    if png is not None:
        draw(replay, replay.worst_at if at is None else at, png)
    if mcap is not None:
        progress("messages")
        # Imported here: not every user needs its libraries.
        from phalanx_viewer.export.mcap import write_mcap

        write_mcap(recorded, mcap)
    if rerun is not None:
        progress("entities")
        from phalanx_viewer.export.rerun import write_rerun

        write_rerun(recorded, rerun)
    written = [path for path in (html, png, mcap, rerun) if path is not None]
    for ending, folder in (("parquet", parquet), ("csv", csv)):
        if folder is not None:
            written += _write_tables(recorded, replay.model.swarm, folder, ending)
    return written


def _write_tables(recording: Recording, swarm: Swarm, folder: Path, ending: str) -> list[Path]:
    """Write every table as <folder>/<table>.<ending>; return the paths."""
    tables = {
        "states": states_table(recording, swarm),
        "h": h_table(recording, swarm),
        "inputs": inputs_table(recording, swarm),
        "links": links_table(recording),
        "events": events_table(recording),
        "metrics": metrics_table(recording, swarm),
    }
    folder.mkdir(parents=True, exist_ok=True)
    paths = {folder / f"{name}.{ending}": table for name, table in tables.items()}
    for path, table in paths.items():
        if ending == "csv":
            # Lists become one text each: CSV has none.
            table.with_columns(pl.col(pl.List(pl.String)).list.join("; ")).write_csv(path)
        else:
            table.write_parquet(path)
    return list(paths)
