"""The plan of a study: a scenario, the fields that vary, and seeds; each of its runs is a case."""

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, ValidationError, model_validator

from phalanx.network.draws import Draws
from phalanx.scenario.load import described, read_table, reading_of, validate, value_from
from phalanx.scenario.load import load as load_scenario
from phalanx.scenario.model import Reading, Scenario, ScenarioError, Seed
from phalanx.schema.fields import Distribution, Strict, Values, field_error

_STRING_OR_CHARACTER = re.compile(r""""(?:\\.|[^"\\])*"|'[^']*'|.""", re.DOTALL)


class Point(NamedTuple):
    """The fields in which the runs of one point of the grid differ from the scenario."""

    number: int
    axes: dict[str, Any]
    """The varied fields by path."""
    overrides: dict[str, Any]
    """All fields by path, with those that every run overrides."""


class Case(NamedTuple):
    """One run of a study."""

    row: int
    """Its index in the plan."""
    point: Point
    seed: int


class Plan(Strict):
    """The runs of a study: every point of the grid with every seed.

    A point has one value of each axis in `vary`, the fields of one entry of `points`, and one draw
    of every field in `draw`.
    """

    scenario: str | dict[str, Any]
    """The file or the name of a shipped scenario, or its table."""
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    """In a file also as text: "0:200" are the seeds 0 to 199."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """Fields of every run, by path."""
    vary: dict[str, Values] = Field(default_factory=dict)
    """The values of each axis, by its field's path; the grid has all their combinations."""
    points: tuple[dict[str, Any], ...] = ()
    """Fields by path, one table for each point, in place of a grid or combined with it."""
    draw: dict[str, Distribution] = Field(default_factory=dict)
    """Fields drawn at random, by path."""
    draws: Annotated[int, Field(ge=1)] | None = None
    """Number of draws, each with every seed; 1 by default."""
    draw_seed: Seed = 0
    """Seed of the draws: draw 731 is the same in every study with this seed and field."""

    @model_validator(mode="before")
    @classmethod
    def _seeds_from_text(cls, table: Any) -> Any:
        if isinstance(table, dict) and isinstance(table.get("seeds"), str):
            return {**table, "seeds": seeds_from(table["seeds"])}
        return table

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(set(self.seeds)) < len(self.seeds):
            raise field_error(("seeds",), "expected every seed once", list(self.seeds))
        if self.draws is not None and not self.draw:
            raise field_error(("draws",), "expected fields to draw, in `draw`", self.draws)
        owner: dict[str, str] = {}
        in_points = dict.fromkeys(path for point in self.points for path in point)
        parts = {
            "overrides": self.overrides, "vary": self.vary, "points": in_points, "draw": self.draw,
        }  # fmt: skip
        for part, fields in parts.items():
            for path in fields:
                for other, first in owner.items():
                    if _overlap(path, other):
                        message = f"expected fields that nothing else sets, {first} sets {other}"
                        raise field_error((part, path), message, path)
                owner[path] = part
        if "seed" in owner:
            raise field_error((owner["seed"], "seed"), "expected seeds in `seeds`", "seed")
        self._require_written()
        return self

    def _require_written(self) -> None:
        """Raise ValidationError if a value is None, or has one inside: a file cannot say that."""
        choices = {path: law.choice for path, law in self.draw.items() if law.choice}
        parts = [("overrides", self.overrides), ("vary", self.vary), ("draw", choices)]
        for part, fields in [*parts, *(("points", point) for point in self.points)]:
            for path, value in fields.items():
                if _has_none(value):
                    message = "expected no None: leave the field out (some of `points` may)"
                    raise field_error((part, path), message, value)

    @property
    def name(self) -> str:
        """The scenario's name, or that of its file."""
        if isinstance(self.scenario, dict):
            return str(self.scenario.get("name", "study"))
        return Path(self.scenario).name.removesuffix(".toml")

    @property
    def axes(self) -> list[str]:
        """Paths of the fields in which points differ."""
        return list(dict.fromkeys([*self.vary, *itertools.chain(*self.points), *self.draw]))

    @cached_property
    def _grid(self) -> list[dict[str, Any]]:
        values = itertools.product(*self.vary.values())
        return [dict(zip(self.vary, point, strict=True)) for point in values]

    @property
    def size(self) -> int:
        """Number of runs."""
        return self.points_count * len(self.seeds)

    @property
    def points_count(self) -> int:
        """Number of points."""
        return len(self._grid) * max(1, len(self.points)) * (self.draws or 1)

    def point(self, number: int) -> Point:
        """Return the point of this number."""
        rest, draw = divmod(number, self.draws or 1)
        grid, entry = divmod(rest, max(1, len(self.points)))
        chosen = dict(self.points[entry]) if self.points else {}
        draws = {
            path: distribution.at(Draws(self.draw_seed, "study", path).value(draw))
            for path, distribution in self.draw.items()
        }
        axes = {**self._grid[grid], **chosen, **draws}
        return Point(number, axes, {**self.overrides, **axes})

    def cases(self) -> Iterator[Case]:
        """Yield all runs; those of one point follow each other."""
        seeds = len(self.seeds)
        for number in range(self.points_count):
            point = self.point(number)
            for rank, seed in enumerate(self.seeds):
                yield Case(number * seeds + rank, point, seed)

    def case(self, index: int) -> Case:
        """Return the run of this index. Raises ValueError if there is none."""
        if not 0 <= index < self.size:
            raise ValueError(f"row: expected 0 to {self.size - 1}, got {index}")
        number, rank = divmod(index, len(self.seeds))
        return Case(index, self.point(number), self.seeds[rank])

    @cached_property
    def table(self) -> dict[str, Any]:
        """The scenario's table. Raises ScenarioError."""
        return read_table(self.scenario)

    def load(self, case: Case) -> Scenario:
        """Return a run's resolved scenario. Raises ScenarioError."""
        scenario = load_scenario(self.table, case.point.overrides, case.seed)
        return scenario.model_copy(update={"reading": self._reading(case)})

    def undrawn(self, overrides: Mapping[str, Any]) -> Scenario:
        """Return a scenario before a seed draws starts and obstacles. Raises ScenarioError."""
        return validate(read_table(self.table, overrides), "scenario", drawn=False)

    def command(self, case: Case) -> str:
        """Return the command that runs a case alone, whether or not its scenario is valid."""
        return self._reading(case).command(case.seed)

    def _reading(self, case: Case) -> Reading:
        source = self.scenario if isinstance(self.scenario, str) else str(self.table.get("name"))
        return reading_of(source, case.point.overrides)

    def require_axes(self) -> None:
        """Raise ScenarioError if the scenario is invalid, with every value of an axis if any.

        Seeds without room for what they draw are refused one by one, as rows.
        """
        first = self.point(0).overrides
        if not self.axes and (error := self._error(first)):
            raise error
        for path in self.axes:
            values = self.vary.get(path) or [self.point(0).axes.get(path)]
            errors = [self._error({**first, path: value}) for value in values]
            if all(errors):
                raise ScenarioError(f"no run can begin with any value of {path}: {errors[0]}")

    def _error(self, overrides: Mapping[str, Any]) -> ScenarioError | None:
        try:
            self.undrawn(overrides)
        except ScenarioError as error:
            return error
        return None


def plan_from(table: Mapping[str, Any], source: str = "study") -> Plan:
    """Build a plan from its table. Raises ScenarioError that lists every problem found."""
    try:
        return Plan.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(described(error, source)) from error


def read_plan(path: Path) -> Plan:
    """Read a study.toml. Raises ScenarioError if it cannot be read, is not TOML, or not a plan."""
    return plan_from(read_table(path), str(path))


def seeds_from(text: str) -> tuple[int, ...]:
    """Read seeds: "7", "0:200" for 0 to 199, or several of them, "0:10,17".

    Raises ValidationError of the field `seeds`.
    """
    seeds: list[int] = []
    for part in text.split(","):
        if not (match := re.fullmatch(r"\s*(\d+)(?::(\d+))?\s*", part)):
            raise field_error(("seeds",), "expected seeds as 0:200 or 1,2,5", text)
        first, end = int(match[1]), int(match[2] or int(match[1]) + 1)
        if not first < end <= first + 10**7:
            raise field_error(("seeds",), "expected a first seed and a larger end", part.strip())
        seeds += range(first, end)
    return tuple(seeds)


def values_from(text: str) -> list[Any]:
    """Read the values of an axis, as "0,.1,.3" or "paper,split" or "[1,2],[3,4]"."""
    parts, depth = [""], 0
    for token in _STRING_OR_CHARACTER.findall(text):
        depth += (token in "[{(") - (token in ")}]")
        if token == "," and depth <= 0:
            parts.append("")
        else:
            parts[-1] += token
    return [value_from(part.strip()) for part in parts]


def distribution_from(text: str) -> dict[str, Any]:
    """Read a distribution, as "uniform(0,1)" or "choice(paper,split)". Raises ValueError."""
    match = re.fullmatch(r"\s*(uniform|log-uniform|choice)\((.*)\)\s*", text)
    if not match:
        raise ValueError(f"expected uniform(a,b), log-uniform(a,b) or choice(a,b,...), got {text}")
    values = values_from(match[2])
    return {match[1]: values if match[1] == "choice" else _numbers(values, text)}


def _numbers(values: Sequence[Any], text: str) -> list[float]:
    if len(values) != 2 or not all(isinstance(value, int | float) for value in values):
        raise ValueError(f"expected two numbers, got {text}")
    return [float(value) for value in values]


def _overlap(path: str, other: str) -> bool:
    """Return whether two paths set the same field, or one a part of the other."""
    shorter, longer = sorted((path, other), key=len)
    return longer == shorter or longer.startswith(f"{shorter}.")


def _has_none(value: Any) -> bool:
    inside = list(value.values()) if isinstance(value, Mapping) else value
    return value is None or (isinstance(inside, list | tuple) and any(map(_has_none, inside)))


def as_text(value: Any) -> Any:
    """Return a value for a column: a list or a table as JSON, others as they are."""
    return json.dumps(value) if isinstance(value, list | tuple | dict) else value
