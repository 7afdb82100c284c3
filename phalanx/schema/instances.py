"""Objects in place of tables: the class and the fields of one, as a scenario names them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from phalanx.schema.registry import BUILT_IN


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
    given = {f.name: getattr(value, f.name) for f in dataclasses.fields(cls) if f.init}
    return {"type": _name(cls), **{k: _plain(cls, k, v) for k, v in given.items()}}


def _name(cls: type) -> str:
    short = {found: name for known in BUILT_IN.values() for name, found in known.items()}
    return short.get(cls, f"{cls.__module__}:{cls.__qualname__}")


def _plain(cls: type, field: str, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(cls, field, each) for each in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(cls, field, each) for key, each in value.items()}
    if isinstance(value, bool | int | float | str) or dataclasses.is_dataclass(value):
        return as_table(value)
    raise ValueError(
        f"expected numbers, texts, lists and tables in {cls.__name__}.{field}, which a recording "
        f"can keep, got {type(value).__name__}: let it read a file, and give its path"
    )
