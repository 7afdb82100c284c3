"""The file that other tests break: it works, and every part of it is needed or checked."""

import copy
import tomllib
from typing import Any

import pytest

from phalanx.scenario.load import ScenarioError, load, validate
from tests.unit.scenario.broken import working, written


def test_the_file_that_is_broken_here_works_when_it_is_not(tmp_path):
    assert load(written(working(), tmp_path)).name == "unicycles"


def test_every_field_of_the_working_file_is_needed_or_checked():
    table: dict[str, Any] = tomllib.loads(working())
    for key in ("safety", "agents", "name", "duration"):
        lacking = copy.deepcopy(table)
        del lacking[key]
        with pytest.raises(ScenarioError, match=f"{key}: expected a value"):
            validate(lacking, "file")
    for key in table:
        wrong = copy.deepcopy(table) | {key: 5.5j}
        with pytest.raises(ScenarioError, match=f"file: {key}"):
            validate(wrong, "file")
