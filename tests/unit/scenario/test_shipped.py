"""The scenarios that ship, each of which starts in its safe set, and what docs/scenario.md has."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from phalanx.scenario.load import load, shipped
from phalanx.scenario.model import MAX_AGENTS
from phalanx.scenario.safety import Safety
from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.registry import lookup
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.rows.decision import decide
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import paper_row
from tests.unit.swarms import rows_of_scenario


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_scenario_has_its_own_name_and_starts_in_its_safe_set(name):
    rows = rows_of_scenario(name)
    swarm = rows.swarm
    assert swarm.scenario.name == name.replace("/", "-")
    assert swarm.start().shape == (sum(len(m.dynamics.states) for m in swarm.members),)
    assert (rows.invariants()(swarm.start())[0] <= 0).all()


def test_simulation_2_is_the_papers():
    rows = rows_of_scenario("formation3d")
    swarm = rows.swarm
    assert rows.chain.relative_degree == 2
    assert len(swarm.normal) == 4
    assert len(swarm.members) == 8
    assert len(swarm.safe_set.pairs) == 6 + 16 + 40


def test_surrounded_by_equals_no_input_keeps_the_row():
    rows = rows_of_scenario("surrounded")
    terms = rows.terms(0)(rows.swarm.start())
    row = paper_row(terms, 0, {})
    decision = decide(terms, 0, row, np.zeros(2), NearestInput((1.0, 1.0)), 0.0)
    assert terms.least[0] > row.bound
    assert decision.residual > 0


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


def test_the_first_file_on_the_page_is_a_scenario(tmp_path):
    file = tmp_path / "swap.toml"
    file.write_text(PAGE.split("```toml\n")[1].split("```")[0])
    assert [group.names for group in load(str(file)).agents] == [("east", "west"), ("rogue",)]


def test_the_page_has_the_largest_swarm():
    assert f"at most {MAX_AGENTS} agents" in PAGE


def test_every_choice_of_safety_is_on_the_page():
    assert [name for name in Safety.model_fields if f"`safety.{name}`" not in PAGE] == []
