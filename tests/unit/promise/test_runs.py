"""Runs in which agents keep the rule: what is promised before, and what is kept after."""

from collections import Counter

import numpy as np
import pytest

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.simulation import Simulation
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.swarm.keep import Keeper
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from tests.unit.tables import group, swarm_table

pytestmark = pytest.mark.slow

TABLE = swarm_table(
    group(
        "a b",
        "normal",
        [[-1.5, 0.0], [1.5, 0.1]],
        speed=1.0,
        law={"type": "track-velocity", "gain": 5.0},
        controller={"type": "none"},
        clock={"period": 0.05, "jitter": 0.02},
        disturbance={"bound": 0.05, "kind": "adverse"},
        goal=[[1.5, 0.0], [-1.5, 0.1]],
    ),
    group(
        "rogue",
        "adversary",
        [[0.0, 3.5, -1.5]],
        period=0.05,
        dynamics={"type": "unicycle", "speed": 2.0, "turn_rate": 4.0},
        law={"type": "pursue", "gain": 5.0},
    ),
    function="distance",
    safety={"alpha": [3.0], "margin": "integrated", "keep": "hold"},
    duration=3.0,
    obstacles=[{"center": [0.0, -2.5], "clearance": 0.5}],
)
"""Two that want to pass one another, with no filter, and one that hunts them."""


def scenario(**changes) -> Scenario:
    return load(TABLE, {path.replace("__", "."): value for path, value in changes.items()})


JERKS = {"type": "triple-integrator", "jerk": 1.0, "dimension": 2}


def simulate(of: Scenario) -> Summary:
    return Simulation(require_runnable(build_swarm(of))).run()


def promise_after(*faults: dict, **changes):
    return simulate(scenario(faults=[*faults], **changes)).promise


def test_without_the_rule_two_collide_and_with_it_they_never_do():
    """A robot that stands is hit by the rogue, and its promise is kept."""
    without = simulate(scenario(safety__keep=None))
    assert "a-b" in {v.pair for v in without.violations}
    assert without.promise is None
    summary = simulate(scenario())
    assert summary.outcome is Outcome.VIOLATED
    assert {v.pair for v in summary.violations} <= {"a-rogue", "b-rogue"}
    assert summary.origins["fallback"] > 0
    assert summary.origins["controller-projected"] > 0
    assert str(summary.promise) == "kept for 5 of 5 pairs (3 for ever, 2 passively)"
    assert summary.promise.lost_at is None


@pytest.mark.parametrize(
    ("fault", "agent", "why", "pairs"),
    [
        pytest.param(
            {"kind": "pause", "at": 0.5, "for": 0.3, "agents": ["a"]}, "a", "silent", 2, id="pause"
        ),
        pytest.param({"kind": "kill", "at": 0.5, "agents": ["b"]}, "b", "silent", 2, id="kill"),
    ],
)  # fmt: skip
def test_what_breaks_a_promise_is_named_with_its_agent_and_time(fault, agent, why, pairs):
    promise = promise_after(fault)
    assert not promise.kept
    assert [b.agent for b in promise.broken] == [agent]
    assert why in promise.broken[0].why
    assert promise.lost_at >= fault["at"]
    assert promise.for_ever + promise.passively == pairs
    assert f"broken at {promise.lost_at:.3f} s by {agent}" in str(promise)


def test_a_turn_leaves_the_others_what_they_keep_by_themselves():
    promise = promise_after({"kind": "turn", "at": 0.5, "agents": ["b"]})
    assert promise.kept
    assert list(promise.turned) == ["b"]
    # a-obstacle; a with b and the rogue. b is promised nothing more.
    assert (promise.for_ever, promise.passively, promise.promised) == (1, 2, 3)


def test_the_room_counts_what_integration_may_be_off():
    unpushed = build_swarm(scenario(agents__0__disturbance={"bound": 0.0}))
    keeper, x = Keeper(unpushed, 0), unpushed.start()
    assert keeper.tube(x, np.zeros(2)).radius[0] >= 1e-4 * 0.07


@pytest.mark.parametrize("controller", ["cbf-qp", "escape"])
def test_controllers_of_baselines_keep_the_rule_too(controller):
    changed = scenario(agents__0__controller={"type": controller}, duration=1.0)
    assert simulate(changed).promise.kept


def test_by_unknown_roles_all_is_passive():
    summary = simulate(scenario(safety__information="unknown", duration=1.0))
    assert (summary.promise.for_ever, summary.promise.passively) == (2, 3)
    assert summary.promise.kept


DOUBLE = {
    "agents__0__dynamics": {"type": "double-integrator", "acceleration": 3.0, "dimension": 2},
    "agents__0__law": {"type": "track", "gains": [1.0, 2.0]},
    "agents__0__start": [[-2.5, 0.0, 1.0, 0.0], [2.5, 0.1, -1.0, 0.0]],
    "agents__1__dynamics": {"type": "double-integrator", "acceleration": 2.0, "dimension": 2},
    "agents__1__start": [[0.0, 8.0, 0.0, 0.0]],
    "agents__1__law": {"type": "chase", "gains": [1.0, 2.0]},
    "safety__alpha": [2.0, 2.0],
}
"""The same by accelerations, which count on the shortest gap too: 0.05 - 0.02 s."""


def test_a_double_integrator_keeps_the_rule():
    summary = simulate(scenario(**DOUBLE))
    assert summary.promise.kept
    assert summary.promise.for_ever == 3
    assert summary.origins["fallback"] > 0


def test_the_rule_decides_the_same_where_far_members_are_left_out():
    swarm = build_swarm(scenario())
    keeper, members, rng = Keeper(swarm, 0), (0, 1, 2), np.random.default_rng(0)
    decided = set()
    for n in range(200):
        x, u = swarm.start(), rng.uniform(-1.0, 1.0, 2)
        x[:4] = rng.uniform(-1.6, 1.6, 4)
        if n % 2:  # near the obstacle alone
            x[:4] = [rng.uniform(-1.0, 1.0), rng.uniform(-2.0, -1.5), 9.0, 9.0]
        whole = keeper.room(x, np.array(members), u).least >= 0.0
        assert keeper(0.0, x, members, u).accepted is whole
        keeper.restart()
        decided.add(whole)
    assert decided == {False, True}


def test_the_judge_decides_the_same_while_it_knows_that_nothing_can_come_near():
    swarm = build_swarm(scenario(agents__0__start=[[-3.0, -3.0], [3.0, 3.0]]))
    agent, judge, x = Keeper(swarm, 0), Keeper(swarm, 0, true_states=True), swarm.start()
    decided, skipped, u = Counter(), 0, np.ones(2)
    for t in 0.05 * np.arange(80):
        skipped += t < judge._alone_until
        answer, judged = agent(t, x, (0, 1, 2), u), judge(t, x, range(3), u)
        assert (judged.u.tolist(), judged.accepted) == (answer.u.tolist(), answer.accepted)
        decided[answer.accepted] += 1
        # Both come as fast as they can.
        x[:2] += 0.05 * answer.u
        x[2:4] -= 0.05
    assert 20 < skipped < decided[True] < 80


@pytest.mark.parametrize(
    ("changes", "field", "fix"),
    [
        ({"safety__function": {"type": "heading-aware", "radius": 1.0, "kappa": 0.1},
          "agents__0__dynamics": {"type": "unicycle", "speed": 1.0, "turn_rate": 2.0},
          "agents__0__start": [[-1.5, 0.0, 0.0], [1.5, 0.1, 3.0]]},
         "safety.function", "expected 'distance' or 'separation'"),
        ({"time__latency": 0.01}, "time.latency", "expected 0"),
        ({"limits": [{"type": "fence", "center": [0.0, 0.0], "radius": 9.0}]},
         "limits", "write a wall as an obstacle"),
        ({"agents__0__disturbance__bound": 1.5}, "disturbance.bound of a",
         "in one of them it has 1"),
        ({"agents__0__sensing": 1.1}, "sensing of a", "expected at least 1.26 m, got 1.1"),
        ({"agents__0__dynamics": JERKS, "agents__1__dynamics": JERKS,
          "agents__0__start": [[-2.5, *5 * [0.0]], [2.5, *5 * [0.0]]],
          "agents__0__law": {"type": "track", "gains": [1.0, 2.0, 2.0]},
          "agents__1__start": [[0.0, 8.0, *4 * [0.0]]], "safety__alpha": [1.0, 1.0, 1.0],
          "agents__1__law": {"type": "chase", "gains": [1.0, 2.0, 2.0]}},
         "dynamics of a", "expected a single- or double-integrator"),
    ],
)  # fmt: skip
def test_what_is_not_covered_is_refused_with_its_field_and_the_fix(changes, field, fix):
    with pytest.raises(ScenarioError) as error:
        simulate(scenario(**changes))
    assert "points: safety.keep: " in str(error.value)
    assert field in str(error.value)
    assert fix in str(error.value)


def test_radio_is_refused():
    changed = load("crossing-radio", {"safety.keep": "hold"})
    with pytest.raises(ScenarioError, match=r"radio of \S+: expected none"):
        require_runnable(build_swarm(changed))


def test_one_controller_for_all_keeps_no_fallback():
    with pytest.raises(ScenarioError, match=r"safety\.keep: expected none"):
        load("centralised", {"safety.keep": "hold"})
