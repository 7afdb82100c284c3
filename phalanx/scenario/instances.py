"""Objects of users' classes, which may keep what they were asked: none shares its memory.

What an agent, a link or an expression gets must depend neither on who asked before nor on the
process: two engines would come to two trajectories.
"""

import copy
import dataclasses
import functools
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any


def separate(cls: type, fields: Mapping[str, Any]) -> Any:
    """Make an object whose fields, defaults and attributes of the class no other object has."""
    defaults = {
        f.name: f.default
        for f in (dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ())
        if f.init and f.default is not dataclasses.MISSING
    }
    given = {**dict(_copied(defaults)), **copy.deepcopy(dict(fields))}
    return _subclass(cls, dict(_copied(_attributes(cls))))(**given)


def asked_anew(cls: type, methods: tuple[str, ...], fields: Mapping[str, Any]) -> Any:
    """Make an object that puts each call of these methods to a new object of its class.

    What they return are expressions: how often they were asked for must not matter.
    """
    made = _asking_anew(cls, methods)(**copy.deepcopy(dict(fields)))
    object.__setattr__(made, "_given", fields)
    return made


@cache
def _asking_anew(cls: type, methods: tuple[str, ...]) -> type:
    calls = {name: getattr(cls, name, None) for name in methods}
    return _subclass(cls, {n: _anew(cls, n, call) for n, call in calls.items() if callable(call)})


def _anew(cls: type, name: str, call: Any) -> Any:
    @functools.wraps(call)
    def ask(self: Any, *arguments: Any) -> Any:
        # While it is made it has not been given anything yet.
        asked = separate(cls, self._given) if "_given" in vars(self) else super(type(self), self)
        return getattr(asked, name)(*arguments)

    return ask


def _subclass(cls: type, attributes: Mapping[str, Any]) -> type:
    names = {"__module__": cls.__module__, "__qualname__": cls.__qualname__}
    return type(cls)(cls.__name__, (cls,), {**names, **attributes})


def _attributes(cls: type) -> dict[str, Any]:
    """What the class keeps itself: neither methods nor other descriptors."""
    every = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
    return {
        name: value
        for name, value in every.items()
        if not name.startswith("__") and not hasattr(value, "__get__")
    }


def _copied(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Those that can change, copied; what cannot be copied stays one for all."""
    for name, value in values.items():
        try:
            copied = copy.deepcopy(value)
        except Exception:  # a lock, a module, whatever a user's own copying raises
            continue
        if copied is not value:
            yield name, copied
