"""Compiled functions that serve the next run of the same process too, by what they compute."""

import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from phalanx.theory.expressions.native import generation

T = TypeVar("T")

_MOST = 64
"""Results that each thread keeps; the oldest goes first."""


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
    if key not in found:
        made = make()
        while len(found) >= _MOST:
            del found[next(iter(found))]
        found[key] = made
    result: T = found[key]
    return result
