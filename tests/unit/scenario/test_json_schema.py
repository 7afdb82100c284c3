"""The JSON Schema of a scenario: shipped files conform, and common mistakes do not."""

import copy
import json
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from phalanx.cli.app import status
from phalanx.scenario.load import load, shipped
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.json_schema import json_schema
from phalanx.schema.registry import registered
from phalanx.theory.models.world import World

ROOT = Path(__file__).parents[3]
EXAMPLES = [
    path
    for folder in ("examples", "evidence")
    for path in sorted((ROOT / folder).rglob("*.toml"))
    if "agents" in tomllib.loads(path.read_text("utf-8")) and "pyproject" not in path.name
]


@cache
def validator() -> jsonschema.Draft202012Validator:
    schema = json_schema(Scenario)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@cache
def table(name: str) -> Mapping[str, Any]:
    return tomllib.loads(shipped()[name].read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_scenario_conforms(name):
    validator().validate(table(name))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_examples_scenario_conforms_with_its_users_classes(path):
    validator().validate(tomllib.loads(path.read_text("utf-8")))


# Where in Simulation 1, and what is written there: None for nothing.
MISTAKES = {
    "a misspelt field of the run": (("durration",), 3.0),
    "a misspelt field of a table": (("safety", "roh"), 3.0),
    "a field in the wrong table": (("eta",), 3.0),
    "no dynamics": (("agents", 0, "dynamics"), None),
    "an unknown role": (("agents", 0, "role"), "attacker"),
    "an unknown class": (("agents", 0, "dynamics", "type"), "unicicle"),
    "a misspelt field of a class": (("agents", 0, "dynamics", "sped"), 1.0),
    "a field of a class that lacks": (("agents", 0, "dynamics", "speed"), None),
    "a class of another kind": (("agents", 0, "law", "type"), "separation"),
    "no type": (("safety", "function", "type"), None),
    "a number as text": (("safety", "rho"), "5"),
    "a number that is negative": (("agents", 0, "clock", "period"), -0.01),
    "a number in place of a list": (("safety", "alpha"), 2.0),
    "an unknown information model": (("safety", "information"), "none"),
    "an unknown margin": (("safety", "margin"), "locale"),
    "a probability above one": (("network", "loss"), 1.5),
    "an unknown kind of fault": (("faults",), [{"kind": "explode", "agent": "1", "at": 1.0}]),
    "no agents": (("agents",), []),
}


@pytest.mark.parametrize(("where", "value"), MISTAKES.values(), ids=MISTAKES)
def test_a_common_mistake_is_refused_as_load_does(where, value):
    wrong = copy.deepcopy(dict(table("unicycles")))
    wrong.setdefault("network", {})
    *above, last = where
    inner: Any = wrong
    for key in above:
        inner = inner[key]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    assert not validator().is_valid(wrong)
    with pytest.raises(ScenarioError):
        load(wrong)


def test_every_class_by_name_is_in_it():
    text = json.dumps(validator().schema)
    for kind, homes in BUILT_IN.items():
        missing = [name for name in homes if json.dumps(name) not in text]
        assert missing == [], kind
    assert all(json.dumps(name) in text for name in registered(World))


def test_fields_have_their_docstrings_as_editors_show_them():
    group = validator().schema["$defs"]["AgentGroup"]["properties"]
    assert group["count"]["description"].startswith("Number of agents, instead of names")
    unicycle = next(t for t in group["dynamics"]["oneOf"] if t.get("title") == "Unicycle")
    assert unicycle["properties"]["offset"]["description"].startswith("b [m]")
    assert unicycle["required"] == ["type", "speed", "turn_rate"]


@pytest.mark.slow
def test_the_command_prints_it(capsys):
    assert status(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == validator().schema
