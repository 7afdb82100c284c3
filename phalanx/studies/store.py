"""The folder of a study: its plan and its rows, which survive a crash at any instant.

A finished row is appended to a journal at once. Every thousand rows become a part, a Parquet file
that gets its name when it is whole; at the end all parts become one file. A row that is in two
files, since a crash came between writing one and removing the other, counts once.
"""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec
import polars as pl
import tomli_w

from phalanx.studies.identity import Identity, versions, versions_of_libraries
from phalanx.studies.plan import Plan, read_plan
from phalanx.studies.row import SCHEMA, Row, flat, json_text

PLAN, ROWS = "study.toml", "rows.parquet"
_JOURNAL, _PARTS, _LOCK, _VERSIONS = "rows.journal", "part-*.parquet", "lock", "versions.json"
_PART = 1000
"""Rows in a part."""
_SYNC = 20
"""Rows that a power failure may lose; a crash of the program loses none."""


class StudyError(ValueError):
    """A study's folder cannot be used; the message names it and the reason."""


class Known(NamedTuple):
    """A row that is there already."""

    identity: Identity
    overrides: str
    """As JSON."""
    outcome: str


class Store:
    """The rows in a study's folder; one program writes, others may read."""

    def __init__(self, folder: Path) -> None:
        """Name the folder, which need not exist."""
        self.folder = folder
        self._journal: Any = None
        self._waiting: list[dict[str, Any]] = []
        """Rows that are in the journal only."""
        self._before: pl.DataFrame | None = None
        """All rows, when one was first copied."""

    def open(self, plan: Plan) -> Self:
        """Begin to write, with this plan; rows of another stay. Raises as open_with does."""
        return self.open_with(PLAN, plan_text(plan))

    def open_with(self, name: str, declaration: str) -> Self:
        """Begin to write; what the rows are of goes into a file of this name.

        Raises:
            StudyError: another program writes, or the rows are of another version of Phalanx.
            OSError: the folder cannot be made or written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock()
        self._waiting = self._recovered()
        _replace(self.folder / name, declaration.encode())
        known = {**self._versions(), versions(): versions_of_libraries()}
        _replace(self.folder / _VERSIONS, msgspec.json.format(msgspec.json.encode(known)))
        self._rewrite_journal()
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Make one file of all rows. Raises OSError; then the journal and the parts remain."""
        if self._journal is None:
            return
        try:
            self._merge()
        finally:
            self._journal.close()
            self._journal = None
            os.close(self._lock_file)

    def add(self, row: Row) -> None:
        """Append a row. Raises OSError, for example on a full disk; earlier rows are kept."""
        self._append(flat(row))

    def copy(self, key: str, overrides: dict[str, Any]) -> str:
        """Append the row with this key under other overrides; return its outcome."""
        if self._before is None:
            self._before = self.frame()
        (columns,) = self._before.filter(pl.col("key") == key).tail(1).to_dicts()
        self._append({**columns, "overrides": json_text(overrides)})
        return str(columns["outcome"])

    def _append(self, columns: dict[str, Any]) -> None:
        size = self._journal.tell()
        try:
            self._journal.write(msgspec.json.encode(columns) + b"\n")
            self._journal.flush()
        except OSError:
            with contextlib.suppress(OSError):
                os.truncate(self.folder / _JOURNAL, size)
            raise
        self._waiting.append(columns)
        if len(self._waiting) % _SYNC == 0:
            os.fsync(self._journal.fileno())
        if len(self._waiting) >= _PART:
            self._make_part()

    def known(self) -> Iterator[Known]:
        """Yield the identity of every row that is there."""
        columns = ["scenario", "seed", "modules", "versions", "overrides", "outcome"]
        for *parts, overrides, outcome in self.frame().select(columns).iter_rows():
            yield Known(Identity(*parts), overrides, outcome)

    def describe(self, changed: list[str], before: Identity, now: Identity) -> str:
        """Name the inputs that changed; of versions, which."""
        known = self._versions()
        old, new = known.get(before.versions, {}), known.get(now.versions, {})
        differ = [name for name in sorted(old | new) if old.get(name) != new.get(name)]
        libraries = ", ".join(
            "Phalanx's sources"
            if name == "phalanx"
            else f"{name} {old.get(name)} → {new.get(name)}"
            for name in differ
        )
        return ", ".join(
            libraries or "versions" if name == "versions" else name for name in changed
        )

    def _versions(self) -> dict[str, dict[str, str]]:
        try:
            found = msgspec.json.decode(
                (self.folder / _VERSIONS).read_bytes(), type=dict[str, dict[str, str]]
            )
        except (OSError, msgspec.DecodeError):
            return {}
        return found

    def frame(self) -> pl.DataFrame:
        """Return all rows, the newest last. Raises StudyError if a file is of another version."""
        tables = [self._read(file) for file in self._files()]
        tables.append(pl.DataFrame(self._waiting or self._recovered(), schema=SCHEMA))
        return pl.concat(tables).unique(["key", "overrides"], keep="last", maintain_order=True)

    def _files(self) -> list[Path]:
        whole = self.folder / ROWS
        parts = sorted(self.folder.glob(_PARTS))
        return [whole, *parts] if whole.exists() else parts

    def _read(self, file: Path) -> pl.DataFrame:
        try:
            found = pl.read_parquet(file)
        except (pl.exceptions.PolarsError, OSError) as error:
            raise StudyError(f"{file}: not the rows of a study ({error})") from error
        if dict(found.schema) != SCHEMA:
            other = sorted(set(found.columns) ^ set(SCHEMA))
            raise StudyError(
                f"{file}: the rows of another version of Phalanx ({', '.join(other) or 'types'} "
                "differ): take another folder, or delete this one"
            )
        return found

    def _recovered(self) -> list[dict[str, Any]]:
        """Return the rows of the journal; a torn last line, of a program that died, is dropped."""
        try:
            lines = (self.folder / _JOURNAL).read_bytes().split(b"\n")
        except FileNotFoundError:
            return []
        found = []
        for line in lines[:-1]:
            try:
                row = msgspec.json.decode(line)
            except msgspec.DecodeError as error:
                raise StudyError(f"{self.folder / _JOURNAL}: damaged: {error}") from error
            if not isinstance(row, dict) or row.keys() != SCHEMA.keys():
                raise StudyError(
                    f"{self.folder / _JOURNAL}: rows of another version of Phalanx: take another "
                    "folder, or delete this one"
                )
            found.append(row)
        return found

    def _rewrite_journal(self) -> None:
        lines = [msgspec.json.encode(row) + b"\n" for row in self._waiting]
        _replace(self.folder / _JOURNAL, b"".join(lines))
        if self._journal is not None:
            self._journal.close()
        self._journal = (self.folder / _JOURNAL).open("ab")

    def _make_part(self) -> None:
        taken = [int(file.stem.removeprefix("part-")) for file in self.folder.glob(_PARTS)]
        name = f"part-{max(taken, default=0) + 1:05d}.parquet"
        self._write(pl.DataFrame(self._waiting, schema=SCHEMA), self.folder / name)
        self._waiting = []
        self._rewrite_journal()

    def _merge(self) -> None:
        parts = self._files()
        self._write(self.frame(), self.folder / ROWS)
        for part in parts:
            if part.name != ROWS:
                part.unlink()
        self._waiting = []
        self._rewrite_journal()

    def _write(self, table: pl.DataFrame, file: Path) -> None:
        made = file.with_suffix(".making")
        try:
            table.write_parquet(made)
        except (pl.exceptions.PolarsError, OSError) as error:
            made.unlink(missing_ok=True)
            raise OSError(f"{file}: cannot be written: {error}") from error
        _synced(made)
        made.rename(file)

    def _lock(self) -> None:
        self._lock_file = os.open(self.folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._lock_file)
            raise StudyError(f"{self.folder}: another program is running this study") from error


def plan_of(folder: Path) -> Plan:
    """Read the plan of a study's folder. Raises ScenarioError."""
    return read_plan(folder / PLAN)


def plan_text(plan: Plan) -> str:
    """Return a plan as TOML."""
    table = plan.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=True)
    seeds = plan.seeds
    if len(seeds) > 2 and seeds == tuple(range(seeds[0], seeds[-1] + 1)):
        table["seeds"] = f"{seeds[0]}:{seeds[-1] + 1}"
    return tomli_w.dumps(_without_none(table))


def _without_none(value: Any) -> Any:
    """Return a table without its missing values, which TOML cannot express."""
    if isinstance(value, dict):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple):
        return [_without_none(each) for each in value]
    return value


def _replace(file: Path, content: bytes) -> None:
    """Replace a file's content at once. Raises OSError; then the old one remains."""
    made = file.with_name(f"{file.name}.making")
    try:
        made.write_bytes(content)
        _synced(made)
    except OSError:
        made.unlink(missing_ok=True)
        raise
    made.rename(file)


def _synced(file: Path) -> None:
    with file.open("rb") as opened:
        os.fsync(opened.fileno())
