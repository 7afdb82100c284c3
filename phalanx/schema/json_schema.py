"""The JSON Schema of tables: fields with their docstrings, and the classes that a `type` may name.

Editors complete and check scenario files by it. It says less than validation does: what depends on
several fields, or on a user's class, is found by `phalanx check` alone.
"""

import ast
import inspect
import pkgutil
import sys
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

from pydantic import BaseModel, Field, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.registry import registered, validated

_USERS = {"type": "string", "pattern": r"^[\w.]+:\w+$"}

Schema = dict[str, Any]


class OfKind(NamedTuple):
    """Annotation of a table that names a class of a kind, and has that class's fields."""

    kind: type

    def __get_pydantic_json_schema__(self, _: Any, handler: GetJsonSchemaHandler) -> Schema:
        homes = BUILT_IN.get(self.kind, {})
        tables = [_table(name, home, handler) for name, home in homes.items()]
        others = [{"const": name} for name in registered(self.kind) if name not in homes]
        users = {"properties": {"type": {"anyOf": [*others, _USERS]}}, "required": ["type"]}
        return {"oneOf": [*tables, {"type": "object", **users}]}


def one_of(kind: type) -> Any:
    """Return the annotation of a text that is the name of a built-in class of a kind."""
    return Field(json_schema_extra={"enum": [*BUILT_IN[kind]]})


def _table(name: str, home: str, handler: GetJsonSchemaHandler) -> Schema:
    """Return the schema of a built-in class: its fields, and its name as `type`."""
    cls = validated(pkgutil.resolve_name(home))
    schema = dict(handler.resolve_ref_schema(handler(TypeAdapter(cls).core_schema)))
    properties = {"type": {"const": name}, **schema.get("properties", {})}
    return {**schema, "properties": properties, "required": ["type", *schema.get("required", ())]}


class _Generator(GenerateJsonSchema):
    """Adds fields' docstrings; what has no JSON Schema, such as a law of a law, may be anything."""

    def model_schema(self, schema: Any) -> Schema:
        return _described(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: Any) -> Schema:
        return _described(super().dataclass_schema(schema), schema["cls"])

    def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> Schema:
        return {}

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def json_schema(model: type[BaseModel]) -> Schema:
    """Return the JSON Schema of a model's tables, as a file has them."""
    schema = model.model_json_schema(schema_generator=_Generator)
    return {"$schema": _Generator.schema_dialect, **schema}


def _described(schema: Schema, cls: type) -> Schema:
    bases = [base for base in reversed(cls.__mro__) if base.__module__.startswith("phalanx")]
    for name, field in schema.get("properties", {}).items():
        for base in bases:
            if text := _docstrings(base.__module__).get((base.__name__, name.replace("-", "_"))):
                field["description"] = text
    return schema


@cache
def _docstrings(module: str) -> Mapping[tuple[str, str], str]:
    """Return the docstrings of a module's fields, by class and field, each on one line."""
    texts = {}
    for cls in ast.parse(inspect.getsource(sys.modules[module])).body:
        for field, after in pairwise(cls.body if isinstance(cls, ast.ClassDef) else ()):
            match cls, field, after:
                case (
                    ast.ClassDef(name=home),
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    texts[home, name] = " ".join(text.split())
    return texts
