"""Mistakes in scenarios, a line each: an override, and what is said of it."""

from collections.abc import Mapping, Sequence

import pytest

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError


def cases(table: str) -> list[tuple[str, str]]:
    """The columns of a table, whose lines have one `|` each."""
    rows = (line.split(" | ") for line in table.strip().splitlines())
    return [(left.strip(), right) for left, right in rows]


def refusal(overrides: Sequence[str] | Mapping[str, object], name: str = "unicycles") -> str:
    """All that is said of a scenario with these overrides: a line for each mistake."""
    with pytest.raises(ScenarioError) as error:
        load(name, overrides)
    message = str(error.value)
    assert all(line.startswith(f"{name}: ") for line in message.splitlines())
    return message
