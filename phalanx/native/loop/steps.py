"""Control steps as columns, with lists of what each reports, as the loop writes them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from phalanx.native.loop.memory import MOST_INPUTS, Memory
from phalanx.theory.arrays import Index

Columns = Mapping[str, NDArray[Any]]
_NUMBERS = "i", "k", "t", "origin", "rejected", "residual", "margin"
_LISTS = {
    "ages": ("age_of", "age"),
    "fates": ("fate_from", "fate_k", "fate_delay", "fate_faults"),
    "bindings": ("binding_of",),
}


@dataclass(frozen=True)
class Lists:
    """Lists of entries, one for each step, one after the other."""

    counts: Index
    """Entries of each list, shape (r,)."""
    columns: Columns

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def row(self) -> Index:
        """The step of each entry."""
        return np.arange(len(self.counts)).repeat(self.counts)

    @property
    def place(self) -> Index:
        """The place of each entry in its list."""
        begins = np.cumsum(self.counts) - self.counts
        place: Index = np.arange(self.counts.sum()) - begins.repeat(self.counts)
        return place

    def take(self, rows: Index) -> Self:
        """Return the lists of some steps."""
        counts = self.counts[rows]
        begins = (np.cumsum(self.counts) - self.counts)[rows] - (np.cumsum(counts) - counts)
        entries = begins.repeat(counts) + np.arange(counts.sum())
        return type(self)(counts=counts, columns=_each(self.columns, entries))

    def and_then(self, more: Self) -> Self:
        """Return these lists and more."""
        columns = _both(self.columns, more.columns)
        return type(self)(counts=np.append(self.counts, more.counts), columns=columns)


@dataclass(frozen=True)
class Steps:
    """Consecutive control steps."""

    columns: Columns
    """Numbers of each by their names in run.h, and its own number."""
    lists: Mapping[str, Lists]

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def take(self, rows: Index) -> Self:
        """Return some of them."""
        lists = {name: entries.take(rows) for name, entries in self.lists.items()}
        return type(self)(columns=_each(self.columns, rows), lists=lists)

    def and_then(self, more: Self) -> Self:
        """Return these and more."""
        lists = {name: entries.and_then(more.lists[name]) for name, entries in self.lists.items()}
        return type(self)(columns=_both(self.columns, more.columns), lists=lists)


def _each(columns: Columns, rows: Index) -> Columns:
    return {name: column[rows] for name, column in columns.items()}


def _both(columns: Columns, more: Columns) -> Columns:
    return {name: np.concatenate([column, more[name]]) for name, column in columns.items()}


def written(memory: Memory, count: str, name: str, *shape: int) -> NDArray[Any]:
    """Return a copy of a result as far as it is written; shape: of each of so many entries."""
    entries = int(memory.number(count)[0])
    array: NDArray[Any] = memory[name].reshape(-1, *shape)[:entries].copy()
    return array


def written_steps(memory: Memory, sizes: Index) -> Steps:
    """Return the steps of the last call; sizes: numbers of inputs of each agent."""
    count, widest = int(memory.number("steps")[0]), int(sizes.max())
    columns = {name: written(memory, "steps", f"step_{name}") for name in _NUMBERS}
    columns["number"] = int(memory.number("first_step")[0]) + np.arange(count)
    beyond = np.arange(widest) >= sizes[columns["i"]][:, None]
    for name in ("wish", "u"):
        columns[name] = written(memory, "steps", f"step_{name}", MOST_INPUTS)[:, :widest]
        columns[name][beyond] = 0.0
    lists = {}
    for name, fields in _LISTS.items():
        counts = np.diff(written(memory, "steps", f"step_{name}"), prepend=0)
        lists[name] = Lists(counts, {field: written(memory, name, field) for field in fields})
    return Steps(columns, lists)
