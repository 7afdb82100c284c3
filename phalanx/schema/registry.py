"""Names in a scenario to classes: built-in short names, or a user's "package.module:Name"."""

import copy
import dataclasses
import functools
import inspect
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import pydantic

from phalanx.schema.user_code import import_named
from phalanx.theory.laws.attacks import Chase, WorstCase
from phalanx.theory.laws.law import Law
from phalanx.theory.laws.tracking import Pursue, Track, TrackVelocity
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import KinematicBicycle, Unicycle
from phalanx.theory.safety.class_k import ClassK, Linear, Power
from phalanx.theory.safety.function import Distance, HeadingAware, SafeSetFunction, Separation
from phalanx.theory.safety.limits import Band, Fence, Limit

BUILT_IN: Mapping[type, Mapping[str, type]] = {
    Dynamics: {
        "unicycle": Unicycle,
        "single-integrator": SingleIntegrator,
        "double-integrator": DoubleIntegrator,
        "triple-integrator": TripleIntegrator,
        "bicycle": KinematicBicycle,
    },
    ClassK: {"linear": Linear, "power": Power},
    SafeSetFunction: {
        "separation": Separation,
        "distance": Distance,
        "heading-aware": HeadingAware,
    },
    Limit: {"fence": Fence, "band": Band},
    Law: {
        "track-velocity": TrackVelocity,
        "track": Track,
        "pursue": Pursue,
        "chase": Chase,
        "worst": WorstCase,
    },
}

_EXPRESSIONS = {Dynamics, ClassK, SafeSetFunction, Limit}
"""Kinds whose methods return expressions: how often they were asked for must not matter."""


def lookup(kind: type, name: str) -> type:
    """The class that a scenario names.

    Args:
        kind: Dynamics, SafeSetFunction, Limit, ClassK, Law or Rule: a protocol.
        name: a built-in name, or "package.module:Name" of a dataclass, looked for in the
            working directory too.

    Raises:
        ValueError: unknown name, module that does not import, or a class that is not of the kind.
        UntrustedCodeError: the class may not be imported.
    """
    known = BUILT_IN.get(kind, {})
    if name in known:
        return known[name]
    if ":" not in name:
        raise ValueError(f"expected {_choices(kind)}")
    found = import_named(name)
    missing = [m for m in _members(kind) if not hasattr(found, m) and m not in _fields(found)]
    if not inspect.isclass(found) or not dataclasses.is_dataclass(found) or missing:
        lacks = f"; it lacks {', '.join(missing)}" if missing else ""
        raise ValueError(f"expected a dataclass that is a {kind.__name__}{lacks}")
    return found


def construct(kind: type, table: Mapping[str, Any]) -> Any:
    """Build an object from its scenario table {type = "name", field = value, ...}.

    One of a user's class shares no memory with any other: what an agent, a link or an expression
    gets must depend neither on who asked before nor on the process.

    Raises:
        ValueError: as lookup. pydantic.ValidationError: a field is unknown, missing or wrong.
    """
    if "type" not in table:
        raise ValueError(f"expected a field type, {_choices(kind)}")
    checked = _validated(lookup(kind, str(table["type"])))
    fields = {key: value for key, value in table.items() if key != "type"}
    if not is_users(table):
        return checked(**fields)
    if kind in _EXPRESSIONS:
        return _asked_anew(checked, tuple(_members(kind)), fields)
    return _separate(checked, fields)


def is_users(table: Mapping[str, Any]) -> bool:
    """Whether a table names a user's class."""
    return ":" in str(table.get("type"))


def _choices(kind: type) -> str:
    known = BUILT_IN.get(kind, {})
    return f"one of {', '.join(known)} or package.module:Name" if known else "package.module:Name"


@cache
def _validated(cls: type) -> Any:
    """The same dataclass, its fields checked on construction."""
    forbid = pydantic.ConfigDict(extra="forbid")
    frozen = cls.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return pydantic.dataclasses.dataclass(cls, config=forbid, frozen=frozen)


def _members(kind: type) -> list[str]:
    return [m for m in vars(kind) if not m.startswith("_")]


def _fields(cls: Any) -> set[str]:
    return {f.name for f in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()


def _separate(cls: type, fields: Mapping[str, Any]) -> Any:
    """Make an object whose fields, defaults and attributes of the class no other object has."""
    defaults = {
        f.name: f.default
        for f in (dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ())
        if f.init and f.default is not dataclasses.MISSING
    }
    given = {**dict(_copied(defaults)), **copy.deepcopy(dict(fields))}
    return _subclass(cls, dict(_copied(_attributes(cls))))(**given)


def _asked_anew(cls: type, methods: tuple[str, ...], fields: Mapping[str, Any]) -> Any:
    """Make an object that puts each call of these methods to a new object of its class."""
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
        asked = _separate(cls, self._given) if "_given" in vars(self) else super(type(self), self)
        return getattr(asked, name)(*arguments)

    return ask


def _subclass(cls: type, attributes: Mapping[str, Any]) -> type:
    names = {"__module__": cls.__module__, "__qualname__": cls.__qualname__}
    return type(cls)(cls.__name__, (cls,), {**names, **attributes})


def _attributes(cls: type) -> dict[str, Any]:
    """Attributes that the class keeps itself: neither methods nor other descriptors."""
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
