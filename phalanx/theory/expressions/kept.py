"""Compiled functions that serve the next run of the same process too, by what they compute."""

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

from phalanx.theory.expressions.native import generation
from phalanx.theory.expressions.user_methods import is_built_in

T = TypeVar("T")

_MOST = 64
"""Results that each thread keeps; the one that was not used for longest goes first."""


class _Kept(threading.local):
    """Results by key. Each thread has its own, since a compiled function writes to buffers."""

    def __init__(self) -> None:
        self.found: dict[Hashable, Any] = {}


_kept = _Kept()


def kept(key: Hashable, make: Callable[[], T]) -> T:
    """Return make(), or what it made before for an equal key.

    Args:
        key: all that the result depends on, expressions in serialized form. An object of a user's
            class would not do, since its methods may read what has changed.
        make: compiles the result, which must keep no state.
    """
    key, found = (generation(), key), _kept.found
    made = found.pop(key) if key in found else make()
    while len(found) >= _MOST:
        del found[next(iter(found))]
    found[key] = made
    result: T = made
    return result


def kept_for(of: Sequence[object], key: Hashable, make: Callable[[], T]) -> T:
    """Return make(), which depends on a key and the fields of some objects alone.

    Kept if all classes are ours: their text has all fields.
    """
    if not all(map(is_built_in, of)):
        return make()
    return kept((key, *[(type(each), repr(each)) for each in of]), make)
