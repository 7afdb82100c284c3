"""The memory that the loop in C and Python share: run.h declares it, once for both.

Every field has eight bytes: a number, or the place of an array. So a struct is a row of words.
"""

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.arrays import Array

MOST_INPUTS, MOST_AGENTS, RING, MOST_IN_SEGMENT = 8, 64, 256, 4
"""Sizes in run.h: inputs, agents, broadcasts kept of each, integration steps of a segment."""
FACE = MOST_INPUTS + 1
"""Numbers of a row of U, with its bound."""
_FOLDER = Path(__file__).parent
_DTYPES = {"I": np.dtype(np.int64), "double": np.dtype(np.float64)}
_PLACE = np.dtype(np.uint64)
"""Of keys of draws, and of places of functions and structs."""
_STRUCT = re.compile(r"typedef struct \{\n(.*?)\n\} (\w+);", re.DOTALL)
_LINE = re.compile(r"^  (\w+) ([^;]+);", re.MULTILINE)


class Field(NamedTuple):
    """A field of a struct."""

    dtype: np.dtype[Any]
    array: bool


@cache
def source() -> str:
    """Return the loop in C, all files one after the other."""
    names = "run.h", "draws.c", "links.c", "inbox.c", "terms.c", "rows.c", "laws.c", "loop.c"
    return "".join((_FOLDER / name).read_text("utf-8") for name in names)


@cache
def fields_of(struct: str) -> Mapping[str, Field]:
    """Return the fields of a struct of run.h, in order."""
    bodies = {name: body for body, name in _STRUCT.findall(source())}
    return {
        name.strip(" *"): Field(_DTYPES.get(kind, _PLACE), "*" in name)
        for kind, names in _LINE.findall(bodies[struct])
        for name in names.split(",")
    }


class Memory:
    """A struct, and the arrays that it points to."""

    def __init__(self, struct: str, values: Mapping[str, Any]) -> None:
        """Fill every field. Raises KeyError if the names are not those of the struct."""
        fields = fields_of(struct)
        if fields.keys() != values.keys():
            raise KeyError(f"{struct}: {sorted(fields.keys() ^ values.keys())}")
        self._index = {name: k for k, name in enumerate(fields)}
        self.words: NDArray[np.uint64] = np.zeros(len(fields), np.uint64)
        self.arrays: dict[str, Any] = {}
        for name, field in fields.items():
            if field.array:
                array = np.array(values[name], field.dtype, copy=True, order="C")
                self.arrays[name] = array if array.size else np.zeros(1, field.dtype)
                self.words[self._index[name]] = self.arrays[name].ctypes.data
            else:
                self.number(name, field.dtype)[0] = values[name]

    def number(self, name: str, dtype: Any = np.int64) -> NDArray[Any]:
        """Return a field that is a number, as an array of one that can be written to."""
        index = self._index[name]
        return self.words[index : index + 1].view(dtype)

    def __getitem__(self, name: str) -> Any:
        """Return an array of the struct."""
        return self.arrays[name]


def together(structs: Iterable[Memory]) -> Array:
    """Return structs of one kind as an array of them; they must be kept."""
    return np.concatenate([each.words for each in structs])
