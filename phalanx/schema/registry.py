"""Registry of classes that a scenario names: built-in, or a user's "package.module:Name"."""

import copy
import dataclasses
import functools
import inspect
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any

import pydantic

from phalanx.schema.built_in import BUILT_IN, BY_OPTION, PACKAGES
from phalanx.schema.extensions import installing
from phalanx.schema.user_code import import_named
from phalanx.theory.expressions.user_methods import call_user, checks, is_built_in, located_class
from phalanx.theory.laws.law import Law
from phalanx.theory.margins.margin import Margin
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.world import World
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.function import Limit, SafeSetFunction

_EXPRESSIONS = {Dynamics, ClassK, SafeSetFunction, Limit, Margin}
"""Kinds whose methods return expressions, which must not depend on earlier calls."""

_OPTIONAL: Mapping[type, list[str]] = {
    Dynamics: ["travel"],
    Law: ["join"],
    World: ["close", "require_robots"],
}
"""Methods that a class of a kind may have."""


def lookup(kind: type, name: str) -> type:
    """Return the class of a kind, a protocol, by its name in a scenario.

    name: a built-in one, or "package.module:Name" of a dataclass, for which the working directory
    is searched too.

    Raises ValueError of an unknown name, a failed import, or a class that is not of the kind;
    UntrustedCodeError of a class that may not be imported.
    """
    if home := BUILT_IN.get(kind, {}).get(name) or _installed(kind).get(name):
        return pkgutil.resolve_name(home)  # type: ignore[no-any-return]
    if package := PACKAGES.get(kind, {}).get(name):
        raise ValueError(f"expected what `{installing(package)}` brings")
    if ":" not in name:
        raise ValueError(f"expected {_choices(kind)}")
    cls: type = import_named(name)
    if mistake := _mistake_in(kind, cls):
        raise ValueError(f"expected a dataclass that is a {kind.__name__}{mistake}")
    return cls


def part_of_agent(option: str) -> Any:
    """Import what an option of a scenario asks for: no other agent needs it."""
    return pkgutil.resolve_name(BY_OPTION[option])


@cache
def _installed(kind: type) -> Mapping[str, str]:
    """Return the classes of a kind that other packages registered: "module:Name" by name.

    They are the entry points of the group `phalanx.<kind>`, such as `phalanx.World`.
    """
    return {entry.name: entry.value for entry in entry_points(group=f"phalanx.{kind.__name__}")}


def _mistake_in(kind: type, value: Any) -> str:
    """Return what keeps a user's object from being a dataclass of a kind; empty if nothing."""
    if not inspect.isclass(value):
        return f", not a {type(value).__name__}"
    location, members = located_class(value), _members(kind)
    missing = [m for m in members if not hasattr(value, m) and m not in _fields(value)]
    if missing:
        return f": {location} lacks {', '.join(_call(vars(kind)[m], m) for m in missing)}"
    if not dataclasses.is_dataclass(value):
        return f": write @dataclass above {location}"
    for name in members:
        model, method = vars(kind)[name], inspect.getattr_static(value, name, None)
        if inspect.isfunction(model) and inspect.isfunction(method) and not _accepts(method, model):
            return f": {location} has {_call(method, name)}, write {_call(model, name)}"
    return ""


def _accepts(method: Callable[..., Any], model: Callable[..., Any]) -> bool:
    """Return whether a method can be called with the arguments of another."""
    try:
        inspect.signature(method).bind(*inspect.signature(model).parameters)
    except TypeError:
        return False
    return True


def _call(method: Any, name: str) -> str:
    """Return a method's name and parameters; of a property the name alone."""
    if not inspect.isfunction(method):
        return name
    return f"{name}({', '.join(inspect.signature(method).parameters)})"


def construct(kind: type, table: Mapping[str, Any]) -> Any:
    """Build an object from its scenario table {type = "name", field = value, ...}.

    Objects of a class that is not built in share no memory: results must not depend on earlier
    calls or on the process. Their methods raise MistakenMethodError if they fail, do not return or
    return what they may not.

    Raises as lookup; pydantic.ValidationError if a field is unknown, missing or wrong.
    """
    if "type" not in table:
        raise ValueError(f"expected a field type, {_choices(kind)}")
    checked = validated(lookup(kind, str(table["type"])))
    fields = {key: value for key, value in table.items() if key != "type"}
    for field in dataclasses.fields(checked):
        if field.type is Law and isinstance(fields.get(field.name), Mapping):
            fields[field.name] = construct(Law, fields[field.name])
    if is_built_in(checked):
        return checked(**fields)
    guarded = _guarded(kind, checked)
    if kind not in _EXPRESSIONS:
        return _separate(guarded, fields)
    instance = guarded(**copy.deepcopy(fields))
    object.__setattr__(instance, "_arguments", fields)
    return instance


def is_users(table: Mapping[str, Any]) -> bool:
    """Return whether a table names a user's class."""
    return ":" in str(table.get("type"))


def as_table(value: Any) -> Any:
    """Return the table of a dataclass's object, {type = "module:Name", field = value, ...}.

    Only the fields of its constructor count: each agent gets a new object. Other values stay as
    they are.

    Raises ValueError if the class or a field has no name that a recording can keep.
    """
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    cls = type(value)
    if "<locals>" in cls.__qualname__:
        raise ValueError(
            f"expected a class that has a name in its module: {cls.__qualname__} is made in a "
            "function, so no other program and no recording can name it"
        )
    fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(cls) if f.init}
    home = f"{cls.__module__}:{cls.__qualname__}"
    registered = [*BUILT_IN.values(), *map(_installed, PACKAGES)]
    short = {home: name for homes in registered for name, home in homes.items()}
    return {"type": short.get(home, home), **{k: _plain(cls, k, v) for k, v in fields.items()}}


def _plain(cls: type, field: str, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(cls, field, item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(cls, field, item) for key, item in value.items()}
    if isinstance(value, bool | int | float | str) or dataclasses.is_dataclass(value):
        return as_table(value)
    raise ValueError(
        f"expected numbers, texts, lists and tables in {cls.__name__}.{field}, which a recording "
        f"can keep, got {type(value).__name__}: let it read a file, and give its path"
    )


def _choices(kind: type) -> str:
    return f"one of {', '.join(registered(kind))} or package.module:Name"


def registered(kind: type) -> Mapping[str, str]:
    """Return all short names of classes of a kind, with where each is or its package."""
    return {**BUILT_IN.get(kind, {}), **PACKAGES.get(kind, {}), **_installed(kind)}


@cache
def validated(cls: type) -> Any:
    """Return the dataclass with its fields validated on construction."""
    forbid = pydantic.ConfigDict(extra="forbid", arbitrary_types_allowed=True)
    frozen = cls.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return pydantic.dataclasses.dataclass(cls, config=forbid, frozen=frozen)


def _members(kind: type) -> list[str]:
    return [m for m in vars(kind) if not m.startswith("_")]


def _fields(cls: Any) -> set[str]:
    return {f.name for f in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()


def _separate(cls: type, fields: Mapping[str, Any]) -> Any:
    """Construct an object with copies of its fields, of their defaults and of class attributes."""
    defaults = {
        f.name: f.default
        for f in dataclasses.fields(cls)
        if f.init and f.default is not dataclasses.MISSING
    }
    every = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
    attributes = {  # neither methods nor other descriptors
        name: value
        for name, value in every.items()
        if not name.startswith("__") and not hasattr(value, "__get__")
    }
    arguments = {**dict(_copied(defaults)), **copy.deepcopy(dict(fields))}
    return _subclass(cls, dict(_copied(attributes)))(**arguments)


@cache
def _guarded(kind: type, cls: type) -> type:
    """Make a class whose objects guard each call of a method of the kind.

    A call of an object with `_arguments` runs on a new object, made of these fields.
    """

    def guard(name: str) -> Callable[..., Any]:
        check = checks.get((kind, name))

        @functools.wraps(getattr(cls, name))
        def run(self: Any, *arguments: Any) -> Any:
            def call() -> Any:
                # The constructor may call the method before `_arguments` is set.
                pure = "_arguments" in vars(self)
                target = _separate(cls, self._arguments) if pure else super(guarded, self)
                return getattr(target, name)(*arguments)

            result = call_user(self, name, call)
            return check(self, result, *arguments) if check else result

        return run

    names = [*_members(kind), *_OPTIONAL.get(kind, ())]
    guarded = _subclass(cls, {n: guard(n) for n in names if callable(getattr(cls, n, None))})
    return guarded


def _subclass(cls: type, attributes: Mapping[str, Any]) -> type:
    names = {"__module__": cls.__module__, "__qualname__": cls.__qualname__}
    return type(cls)(cls.__name__, (cls,), {**names, **attributes})


def _copied(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield copies of mutable values; values that cannot be copied stay shared."""
    for name, value in values.items():
        try:
            copied = copy.deepcopy(value)
        except Exception:  # a lock, a module, anything that a user's own copying raises
            continue
        if copied is not value:
            yield name, copied
