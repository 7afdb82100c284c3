"""The folder of a study: its plan and its rows, which survive a crash at any instant.

A finished row is appended to a journal at once. At the end all rows become one Parquet file, which
gets its name when it is whole. A row that is in both, since a crash came between writing one and
emptying the other, counts once.
"""

import contextlib
import fcntl
import io
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Self

import msgspec
import polars as pl
import tomli_w

from phalanx.native.files import whole_file
from phalanx_studies.plan import Plan
from phalanx_studies.row import (
    SCHEMA,
    Identity,
    Row,
    fields_of,
    flat,
)

PLAN, ROWS = "study.toml", "rows.parquet"
_JOURNAL, _LOCK = "rows.journal", "lock"
_SYNC = 20
"""Rows that a power failure may lose; a crash of the program loses none."""


class StudyError(ValueError):
    """A study's folder cannot be used; the message names it and the reason."""


class Store(contextlib.AbstractContextManager["Store"]):
    """The rows in a study's folder; one program writes, others may read."""

    def __init__(self, folder: Path) -> None:
        """Name the folder, which need not exist."""
        self.folder = folder
        self._lock_file: int | None = None
        self._unsynced = 0

    def open(self, plan: Plan) -> Self:
        """Begin to write, with this plan; rows of another stay. Raises as open_with does."""
        return self.open_with(PLAN, plan_text(plan))

    def open_with(self, name: str, declaration: str) -> Self:
        """Begin to write; what the rows are of goes into a file of this name.

        Raises StudyError if another program writes, or the rows are of another version of Phalanx;
        OSError if the folder cannot be made or written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock()
        self._journalled()  # which is refused before anything is replaced
        _replace(self.folder / name, declaration.encode())
        _replace(self.folder / _JOURNAL, self._lines())
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Make one file of all rows. Raises OSError; then the journal remains."""
        if self._lock_file is None:
            return
        try:
            rows = io.BytesIO()
            frame = self.frame()
            pl.concat([frame, fields_of(frame)], how="horizontal").write_parquet(rows)
            _replace(self.folder / ROWS, rows.getvalue())
            os.truncate(self.folder / _JOURNAL, 0)
        finally:
            os.close(self._lock_file)
            self._lock_file = None

    def add(self, row: Row) -> None:
        """Append a row. Raises OSError, for example on a full disk; earlier rows are kept."""
        file = self.folder / _JOURNAL
        size = file.stat().st_size
        try:
            # Opened for each row: what could not be written stays in no buffer.
            with file.open("ab") as journal:
                journal.write(msgspec.json.encode(flat(row)) + b"\n")
                journal.flush()
                self._unsynced = (self._unsynced + 1) % _SYNC
                if not self._unsynced:
                    os.fsync(journal.fileno())
        except OSError:
            with contextlib.suppress(OSError):
                os.truncate(file, size)
            raise

    def entries(self) -> Iterator[tuple[Identity, str, str]]:
        """Yield the identity, the overrides as JSON and the outcome of every row that is there."""
        columns = ["scenario", "seed", "modules", "versions", "overrides", "outcome"]
        for *parts, overrides, outcome in self.frame().select(columns).iter_rows():
            yield Identity(*parts), overrides, outcome

    def frame(self) -> pl.DataFrame:
        """Return all rows, the newest last. Raises StudyError if a file is of another version."""
        whole = self.folder / ROWS
        tables = [self._read(whole)] if whole.exists() else []
        every = pl.concat([*tables, self._journalled()])
        return every.unique(["key", "overrides"], keep="last", maintain_order=True)

    def _read(self, file: Path) -> pl.DataFrame:
        try:
            rows = pl.read_parquet(file)
        except (pl.exceptions.PolarsError, OSError) as error:
            raise StudyError(f"{file}: not the rows of a study ({error})") from error
        if "overrides" in rows.columns:
            rows = rows.drop(fields_of(rows).columns, strict=False)
        if dict(rows.schema) != SCHEMA:
            raise _of_another_version(file, rows.columns)
        return rows

    def _lines(self) -> bytes:
        """Return the journal; a torn last line, of a program that died, is dropped."""
        try:
            text = (self.folder / _JOURNAL).read_bytes()
        except FileNotFoundError:
            return b""
        return text[: text.rfind(b"\n") + 1]

    def _journalled(self) -> pl.DataFrame:
        """Return the rows of the journal."""
        file, lines = self.folder / _JOURNAL, self._lines()
        if not lines:
            return pl.DataFrame(schema=SCHEMA)
        try:
            first = msgspec.json.decode(lines.partition(b"\n")[0], type=dict[str, Any])
            if first.keys() != SCHEMA.keys():
                raise _of_another_version(file, first)
            return pl.read_ndjson(lines, schema=SCHEMA)
        except (pl.exceptions.PolarsError, msgspec.DecodeError) as error:
            raise StudyError(f"{file}: damaged: {error}") from error

    def _lock(self) -> None:
        lock = os.open(self.folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(lock)
            raise StudyError(f"{self.folder}: another program is running this study") from error
        self._lock_file = lock


def _of_another_version(file: Path, columns: Iterable[str]) -> StudyError:
    other = sorted({*columns} ^ SCHEMA.keys())
    return StudyError(
        f"{file}: the rows of another version of Phalanx ({', '.join(other) or 'types'} differ): "
        "take another folder, or delete this one"
    )


def plan_text(plan: Plan) -> str:
    """Return a plan as TOML."""
    table = plan.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    seeds = plan.seeds
    if len(seeds) > 2 and seeds == tuple(range(seeds[0], seeds[-1] + 1)):
        table["seeds"] = f"{seeds[0]}:{seeds[-1] + 1}"
    return tomli_w.dumps(_without_none(table))


def _without_none(value: Any) -> Any:
    """Return a table without its missing values, which TOML cannot express."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def _replace(file: Path, content: bytes) -> None:
    """Replace a file's content at once. Raises OSError; then the old one remains."""
    with whole_file(file) as part, part.open("wb") as opened:
        opened.write(content)
        opened.flush()
        os.fsync(opened.fileno())
