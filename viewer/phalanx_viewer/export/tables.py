"""A recorded run's tables as files."""

from pathlib import Path

from phalanx.native.files import whole_file
from phalanx.recording.metrics.table import metrics_table
from phalanx.recording.read import Recording
from phalanx.recording.tables import events_table, h_table, inputs_table, links_table, states_table
from phalanx.schema.extensions import extras_named
from phalanx.swarm.swarm import Swarm

with extras_named():
    import polars as pl


def write_tables(recording: Recording, swarm: Swarm, folder: Path, ending: str) -> list[Path]:
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
        with whole_file(path) as part:
            if ending == "csv":
                # Lists become one text each: CSV has none.
                table.with_columns(pl.col(pl.List(pl.String)).list.join("; ")).write_csv(part)
            else:
                table.write_parquet(part)
    return list(paths)
