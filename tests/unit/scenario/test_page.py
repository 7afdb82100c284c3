"""docs/scenario.md holds what the code holds: built-in types, their fields and limits."""

import dataclasses
import re
from pathlib import Path

import pytest

from phalanx.scenario.model import MAX_AGENTS
from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.registry import lookup
from phalanx.theory.models.dynamics import Dynamics

PAGE = (Path(__file__).parents[3] / "docs" / "scenario.md").read_text(encoding="utf-8")
NAMED = [(kind, name) for kind, known in BUILT_IN.items() for name in known]


@pytest.mark.parametrize(("kind", "name"), NAMED, ids=[name for _, name in NAMED])
def test_every_built_in_type_is_on_the_page(kind, name):
    assert re.search(rf"[`\"]{name}[`\"]|\b{name}\b", PAGE)


@pytest.mark.parametrize("name", BUILT_IN[Dynamics])
def test_a_dynamics_has_its_fields_on_the_page(name):
    (listed,) = re.findall(rf"`{name}` \(([^)]*)\)", PAGE)
    fields = [field.name for field in dataclasses.fields(lookup(Dynamics, name))]
    assert re.findall(r"`(\w+)`", listed) == fields


def test_the_page_has_the_largest_swarm():
    assert f"at most {MAX_AGENTS} agents" in PAGE
