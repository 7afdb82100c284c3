"""Caches of compiled functions: a scenario's by their role, a thread's by what they compute."""

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

from phalanx.native.library import generation
from phalanx.theory.expressions.user_methods import is_built_in

T = TypeVar("T")


class FunctionCache:
    """Compiled functions, and whatever else keeps no state, by key::

    output = functions.get(("output", group), lambda: motion_function(dynamics))
    """

    def __init__(self, most: int | None = None) -> None:
        """most: results that are kept at once; None for all."""
        self.results: dict[Hashable, Any] = {}
        """By key; the one that was not used for longest is the first."""
        self._most = most

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return make(), or what it made before for an equal key; all that it depends on."""
        results = self.results
        result: T = results.pop(key) if key in results else make()
        results[key] = result
        if self._most is not None and len(results) > self._most:
            del results[next(iter(results))]
        return result


class _OfThread(threading.local):
    """The caches of one thread: compiled functions write to buffers."""

    def __init__(self) -> None:
        self.by_content, self.of_scenarios = FunctionCache(64), FunctionCache(4)


_of_thread = _OfThread()


def cached(key: Hashable, make: Callable[[], T]) -> T:
    """Return make(), or what it made before for an equal key, in this run or in an earlier one.

    Args:
        key: all that the result depends on, expressions in serialized form. An object of a user's
            class would not do, since its methods may read what has changed.
        make: compiles the result, which must keep no state.
    """
    return _of_thread.by_content.get((generation(), key), make)


def cached_for(of: Sequence[object], key: Hashable, make: Callable[[], T]) -> T:
    """Return make(), which depends on a key and the fields of some objects alone.

    Cached if all classes are ours: their text has all fields.
    """
    if not all(map(is_built_in, of)):
        return make()
    return cached((key, *[(type(part), repr(part)) for part in of]), make)


def scenario_functions(fields: str) -> FunctionCache:
    """Return the cache of scenarios that are equal in all that decides on their functions."""
    return _of_thread.of_scenarios.get((generation(), fields), FunctionCache)
