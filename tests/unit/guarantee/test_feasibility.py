"""K_i is empty or not: by vertices for few rows, by a linear program for many."""

import numpy as np
import pytest

from phalanx.guarantee import start
from phalanx.guarantee.start import rows_at_start
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.row import Rows


@pytest.mark.parametrize("seed", range(30))
def test_the_linear_program_says_what_the_vertices_say(seed):
    rng = np.random.default_rng(seed)
    cube = polytope(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6))
    rows = Rows(rng.normal(size=(7, 3)), rng.normal(scale=0.6, size=7))
    u = least_violation(cube, rows)
    assert start._solvable(cube, rows) == bool((rows.a @ u <= rows.bound + 1e-9).all())


def test_both_answers_come_up_among_them():
    cube = polytope(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6))
    assert start._solvable(cube, Rows(np.eye(3), np.zeros(3)))
    assert not start._solvable(cube, Rows(np.eye(3), np.full(3, -1.5)))


def test_an_agent_that_sees_no_other_may_apply_any_input():
    far = {"agents.0.start": [[0.0, 0.0], [900.0, 0.0]], "agents.0.names": ["1", "3"]}
    alone = {**far, "safety.composition": "pairs", "safety.neighbourhood": 5.0}
    scenario = load("one-on-one", {**alone, "agents.1.start": [[0.0, 500.0]]})
    assert rows_at_start(build_rows(build_swarm(scenario))) == {"1": True, "3": True}
