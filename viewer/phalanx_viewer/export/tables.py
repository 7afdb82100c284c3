"""A run's tables as files that data tools read."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import polars as pl

from phalanx.recording.read import Recording
from phalanx.recording.tables import (
    events_table,
    h_table,
    inputs_table,
    links_table,
    states_table,
)
from phalanx.swarm.swarm import Swarm


class Kind(NamedTuple):
    """A kind of file."""

    ending: str
    write: Callable[[pl.DataFrame, Path], None]


PARQUET = Kind("parquet", lambda table, path: table.write_parquet(path))
CSV = Kind("csv", lambda table, path: _flat(table).write_csv(path))


def write_tables(recording: Recording, swarm: Swarm, folder: Path, kind: Kind) -> list[Path]:
    """Write states, h, inputs, links and events as <folder>/<table>.<ending>; the files.

    Raises OSError if one cannot be written.
    """
    tables = {
        "states": states_table(recording, swarm),
        "h": h_table(recording, swarm),
        "inputs": inputs_table(recording, swarm),
        "links": links_table(recording),
        "events": events_table(recording),
    }
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, table in tables.items():
        path = folder / f"{name}.{kind.ending}"
        kind.write(table, path)
        written.append(path)
    return written


def _flat(table: pl.DataFrame) -> pl.DataFrame:
    """With lists as one text each, which is all that CSV holds."""
    return table.with_columns(pl.col(pl.List(pl.String)).list.join("; "))
