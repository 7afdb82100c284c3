"""Limits of one agent alone, fences and bands, together with pairs and obstacles."""

import casadi as ca
import numpy as np
import pytest
from phalanx_plant.world.evaluation import LargestPsi, RelevantPairs

import phalanx
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.safety.function import Body, Fence

SWARM = {"agents.0.count": 40, "agents.1.count": 4, "duration": 1.0}
LEAD_OUT = {
    "formation.path": [[0.0, 6.0], [6.0, 6.0], [12.0, 0.0]],
    "formation.finish": 8.0,
    "duration": 4.5,
}
"""By the end the path of agent 1 has led out of the fence."""
BALL = [{"type": "fence", "center": [0.0, 0.0, 0.0], "radius": 500.0}]


def h_of(limit, p):
    x = ca.SX.sym("x", len(p))
    value = limit.alone(Body(x, x, ("x", "y", "z")[: len(p)]))
    return float(CompiledFunction([x], [value])(np.array(p))[0][0])


def test_a_fence_is_safe_inside_and_about_the_distance_near_it():
    fence = Fence((1.0, 0.0), 8.0)
    assert h_of(fence, [9.0, 0.0]) == pytest.approx(0.0)
    assert h_of(fence, [1.0, 7.9]) == pytest.approx(-0.1, abs=1e-3)
    assert h_of(fence, [1.0, 8.1]) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("center", "circles"), [((1.0, 2.0), 1), ((1.0, 2.0, 3.0), 3)])
def test_the_outline_of_a_fence_is_where_its_h_is_zero(center, circles):
    fence = Fence(center, 8.0)
    lines = fence.outline()
    assert len(lines) == circles
    for line in lines:
        assert line[0] == pytest.approx(line[-1])
        assert [h_of(fence, point) for point in line] == pytest.approx([0.0] * len(line))


@pytest.mark.slow
def test_agents_stay_in_a_fence_that_their_path_leads_out_of():
    run = phalanx.run(phalanx.load("fence", overrides=LEAD_OUT), engine="in-process")
    assert run.summary.outcome is Outcome.GUARANTEED
    worst = run.h.select("1-limit 0", "2-limit 0", "3-limit 0").max().row(0)
    assert all(value <= 0.0 for value in worst)
    assert max(worst) > -0.2


def test_no_limit_is_left_out_where_distant_pairs_are():
    swarm = build_swarm(phalanx.load("swarm", overrides={**SWARM, "limits": BALL}))
    x, functions = swarm.start(), LargestPsi(build_rows(swarm)).functions
    p = swarm.positions(x)
    columns, values, _ = RelevantPairs(swarm, functions)(np.array([x, x]), np.array([p, p]))
    composed = swarm.safe_set
    limits = {k for k, p in enumerate(composed.pairs) if "limit" in composed.label(p)}
    every = swarm.pairs.choose(swarm.pairs.every).h(x)
    assert len(columns) < len(every)
    assert len(limits) == 40
    assert limits <= set(columns.tolist())
    assert values[..., 0].max() == every.max()


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ({"type": "fence", "center": [0.0, 0.0]}, "limits.0.radius: expected a value, got nothing"),
        ({"type": "fense"}, "limits.0: expected one of fence or package.module:Name"),
        ({"type": "fence", "center": [0.0], "radius": 1.0}, "center: expected 2 axes, got 1"),
    ],
)
def test_a_mistaken_limit_is_one_line(table, line):
    with pytest.raises(ScenarioError) as error:
        build_swarm(phalanx.load("fence", overrides={"limits": [table]}))
    assert line in str(error.value)
    assert len(str(error.value).splitlines()) == 1
