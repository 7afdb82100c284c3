"""Field types of a scenario's tables: names, bounded numbers, errors that locate their field."""

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from phalanx.schema.registry import construct, is_users, lookup
from phalanx.schema.user_code import UntrustedCodeError
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import error_line, located_class

CONTROLLER = "controller"
"""Process name of the controller of all normal agents, for safety.control = "centralised"."""
_PROGRAMS = frozenset({"ca", "plant", "viewer", "operator", "router", CONTROLLER})
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


def _check_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("expected 1 to 32 of a-z 0-9 _ - (it becomes part of a key expression)")
    if name in _PROGRAMS:
        raise ValueError(f"expected another name: {name} is the name of a program")
    return name


def _check_sent(number: float) -> float:
    if abs(number) > LARGEST:
        raise ValueError(f"expected at most {LARGEST:g} in size: agents refuse larger numbers")
    return number


Name = Annotated[str, AfterValidator(_check_name)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Sent = Annotated[Finite, AfterValidator(_check_sent)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Probability = Annotated[Finite, Field(ge=0, le=1)]


def _check_finite(table: dict[str, Any]) -> dict[str, Any]:
    """Return a table. Raises ValueError for an infinite number: JSON, as recorded, has none."""
    inside: list[Any] = [table]
    while inside:
        value = inside.pop()
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError("expected finite numbers")
        if isinstance(value, Mapping):
            inside += value.values()
        elif isinstance(value, list | tuple):
            inside += value
    return table


Table = Annotated[dict[str, Any], AfterValidator(_check_finite)]
Values = Annotated[tuple[Any, ...], Field(min_length=1)]

# Tags of unions: pydantic puts them into an error's location, but no field has such a name.
NUMBER, TABLE, WORD, INPUT = "<number>", "<table>", "<word>", "<input>"
SPHERE, WALL, BOX, POLYGON = "<sphere>", "<wall>", "<box>", "<polygon>"
BOUNDS, JITTER, BURST = "<bounds>", "<jitter>", "<burst>"
LIMIT, REFERENCE = "<limit>", "<reference>"


def field_path(location: tuple[str | int, ...]) -> tuple[str, ...]:
    """Return the names and indices of fields in an error's location, without tags."""
    return tuple(str(part) for part in location if not str(part).startswith("<"))


def number_or_table(value: Any) -> str:
    """Return the tag of the alternative that a value belongs to."""
    return NUMBER if isinstance(value, int | float | str | None) else TABLE


class Unquoted(str):
    """Text that an error message shows without quotes, in place of the value that a field got."""

    __slots__ = ()

    __repr__ = str.__str__


class Strict(BaseModel):
    """Base of all tables: immutable; unknown fields and infinite numbers are errors."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False
    )


class Distribution(Strict):
    """The distribution of a field, as a study draws it or a search varies it: one of the three."""

    uniform: tuple[Finite, Finite] | None = None
    """Least and largest value."""
    log_uniform: tuple[Finite, Finite] | None = Field(None, alias="log-uniform")
    """Least and largest value, both positive; their logarithm is uniform."""
    choice: Values | None = None
    """Values of equal probability."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        kinds = [kind for kind in (self.uniform, self.log_uniform, self.choice) if kind is not None]
        if len(kinds) != 1:
            raise ValueError("expected one of uniform, log-uniform and choice")
        if self.choice is None and not kinds[0][0] < kinds[0][1]:
            raise ValueError("expected the least value first, then the largest")
        if self.log_uniform and self.log_uniform[0] <= 0.0:
            raise ValueError("expected positive values for log-uniform")
        return self

    def at(self, quantile: float) -> Any:
        """Return the value at a quantile in [0, 1)."""
        if self.choice is not None:
            return self.choice[int(quantile * len(self.choice))]
        if self.uniform is not None:
            low, high = self.uniform
            return low + quantile * (high - low)
        assert self.log_uniform is not None
        low, high = map(math.log, self.log_uniform)
        return math.exp(low + quantile * (high - low))


def built(field: str | int, kind: type, table: Table) -> Any:
    """Build an object from its table; its errors become errors of this field."""
    try:
        return construct(kind, table)
    except ValidationError as error:
        lines = [
            InitErrorDetails(
                type=PydanticCustomError(
                    "value", "{msg}", {"msg": _message(e["msg"], kind, table)}
                ),
                loc=(field, *e["loc"]),
                input=e["input"] if e["loc"] else dict(table),
            )
            for e in error.errors()
        ]
        raise ValidationError.from_exception_data(str(field), lines) from error
    except ValueError as error:
        raise field_error((field,), str(error), table.get("type")) from error
    except UntrustedCodeError:
        raise
    except Exception as error:  # a user's class may raise anything while it is constructed
        message = f"expected {table.get('type')} to be made of its fields"
        raise field_error((field,), message, Unquoted(error_line(error))) from error


def _message(message: str, kind: type, table: Table) -> str:
    """Return pydantic's message, ; for an unknown field of a user's class, list those it has."""
    if message.startswith("Tuple should have"):
        return f"expected{message.partition('have')[2].partition(' after')[0]}"
    if message != "Unexpected keyword argument" or not is_users(table):
        return message
    cls = lookup(kind, str(table["type"]))
    names = ", ".join(field.name for field in dataclasses.fields(cls))
    return f"unknown field: {located_class(cls)} has {names or 'none'}"


def field_error(where: tuple[str | int, ...], message: str, value: Any) -> ValidationError:
    """Return a validation error located at a field below the model that raises it."""
    problem = PydanticCustomError("value", "{msg}", {"msg": message})
    return ValidationError.from_exception_data(
        "scenario", [InitErrorDetails(type=problem, loc=where, input=value)]
    )
