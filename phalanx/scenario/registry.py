"""Names in a scenario to classes: built-in short names, or a user's "package.module:Name"."""

import dataclasses
import inspect
from collections.abc import Mapping
from functools import cache
from typing import Any

import pydantic

from phalanx.network.rule import Rule
from phalanx.scenario.instances import asked_anew, separate
from phalanx.scenario.user_code import import_named
from phalanx.theory.laws.chase import Chase
from phalanx.theory.laws.law import Law
from phalanx.theory.laws.tracking import Track
from phalanx.theory.laws.velocity import Pursue, TrackVelocity
from phalanx.theory.laws.worst_case import WorstCase
from phalanx.theory.models.bicycle import KinematicBicycle
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.unicycle import Unicycle
from phalanx.theory.safety.class_k import ClassK, Linear, Power
from phalanx.theory.safety.distances import Distance, HeadingAware
from phalanx.theory.safety.function import SafeSetFunction, Separation
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
    Rule: {},
}


def lookup(kind: type, name: str) -> type:
    """The class that a scenario names.

    Args:
        kind: Dynamics, SafeSetFunction, Limit, ClassK, Law or Rule.
        name: a built-in name, or "package.module:Name" of a dataclass, looked for in the
            working directory too.

    Raises:
        ValueError: unknown name, module that does not import, or a class that is not of the kind.
        UntrustedCodeError: the class may not be imported.
    """
    known = BUILT_IN[kind]
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

    One of a user's class shares no memory with any other.

    Raises:
        ValueError: as lookup. pydantic.ValidationError: a field is unknown, missing or wrong.
    """
    if "type" not in table:
        raise ValueError(f"expected a field type, {_choices(kind)}")
    checked = _validated(lookup(kind, str(table["type"])))
    fields = {key: value for key, value in table.items() if key != "type"}
    if not is_users(table):
        return checked(**fields)
    if kind in (Law, Rule):
        return separate(checked, fields)
    return asked_anew(checked, tuple(_members(kind)), fields)


def is_users(table: Mapping[str, Any]) -> bool:
    """Whether a table names a user's class."""
    return ":" in str(table.get("type"))


def _choices(kind: type) -> str:
    known = BUILT_IN[kind]
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
