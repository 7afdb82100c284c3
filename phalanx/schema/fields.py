"""Fields of a scenario's tables: names, numbers with bounds, errors with a place."""

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from phalanx.schema.registry import construct
from phalanx.schema.user_code import UntrustedCodeError
from phalanx.theory.expressions.asked import in_words

CONTROLLER = "controller"
"""The process that decides for all normal agents where safety.control is "centralised"."""
_PROGRAMS = frozenset({"ca", "plant", "viewer", "operator", "router", "claimant", CONTROLLER})
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


def _check_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("expected 1 to 32 of a-z 0-9 _ - (it becomes part of a key expression)")
    if name in _PROGRAMS:
        raise ValueError(f"expected another name: this one is the {name}'s")
    return name


Name = Annotated[str, AfterValidator(_check_name)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Probability = Annotated[Finite, Field(ge=0, le=1)]
Table = dict[str, Any]

NUMBER, TABLE, SPHERE, WALL = "number", "table", "sphere", "wall"
BOUNDS, JITTER, CHANCE, BURST, GEMODEL = "bounds", "jittered", "chance", "bursts", "gemodel"
WORD, INPUT, LIMIT = "word", "input", "limit"
ALTERNATIVES = frozenset(
    (NUMBER, TABLE, SPHERE, WALL, BOUNDS, JITTER, CHANCE, BURST, GEMODEL, WORD, INPUT, LIMIT)
)
"""Names of alternatives in an error's place, where fields are not called so."""


def number_or_table(value: Any) -> str:
    """Which alternative a value is meant as."""
    return NUMBER if isinstance(value, int | float | str | None) else TABLE


class InWords(str):
    """Something that a field got, where that is better said than shown."""

    __slots__ = ()

    __repr__ = str.__str__


class Strict(BaseModel):
    """Unknown fields and infinite numbers are errors; a scenario does not change once read."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False
    )


def built(field: str | int, kind: type, table: Table) -> Any:
    """Build an object from its table; its errors become errors of this field."""
    try:
        return construct(kind, table)
    except ValidationError as error:
        lines = [
            InitErrorDetails(
                type=PydanticCustomError("value", "{msg}", {"msg": e["msg"]}),
                loc=(field, *e["loc"]),
                input=e["input"],
            )
            for e in error.errors()
        ]
        raise ValidationError.from_exception_data(str(field), lines) from error
    except ValueError as error:
        raise misplaced((field,), str(error), table.get("type")) from error
    except UntrustedCodeError:
        raise
    except Exception as error:  # of a user's own, while it is made
        message = f"expected {table.get('type')} to be made of its fields"
        raise misplaced((field,), message, InWords(in_words(error))) from error


def misplaced(where: tuple[str | int, ...], message: str, value: Any) -> ValidationError:
    """A validation error at a place below the model that raises it."""
    problem = PydanticCustomError("value", "{msg}", {"msg": message})
    return ValidationError.from_exception_data(
        "scenario", [InitErrorDetails(type=problem, loc=where, input=value)]
    )
