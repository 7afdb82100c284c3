"""K_i is empty or not: by vertices for few rows, by a linear program for many."""

import numpy as np

from phalanx.guarantee import start
from phalanx.guarantee.start import rows_at_start
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.row import Rows


def test_the_linear_program_says_what_the_vertices_say():
    cube, answers = polytope(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6)), set()
    for seed in range(30):
        rng = np.random.default_rng(seed)
        rows = Rows(rng.normal(size=(7, 3)), rng.normal(scale=0.6, size=7))
        u = least_violation(cube, rows)
        answers.add(start._solvable(cube, rows))
        assert start._solvable(cube, rows) == bool((rows.a @ u <= rows.bound + 1e-9).all()), seed
    assert answers == {True, False}


def test_an_agent_that_sees_no_other_may_apply_any_input():
    far = {"agents.0.start": [[0.0, 0.0], [900.0, 0.0]], "agents.0.names": ["1", "3"]}
    alone = {**far, "safety.composition": "pairs", "safety.neighbourhood": 5.0}
    scenario = load("one-on-one", {**alone, "agents.1.start": [[0.0, 500.0]]})
    assert rows_at_start(build_rows(build_swarm(scenario))) == {"1": True, "3": True}
