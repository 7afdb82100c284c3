"""The scenarios that ship: each starts in its safe set, and those of the paper are the paper's."""

from pathlib import Path

import numpy as np
import pytest

from phalanx.scenario.load import shipped
from phalanx.scenario.safety import Safety
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


def test_every_choice_of_safety_is_documented():
    page = (Path(__file__).parents[3] / "docs" / "scenario.md").read_text(encoding="utf-8")
    assert [name for name in Safety.model_fields if f"`safety.{name}`" not in page] == []


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
