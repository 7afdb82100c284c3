"""An agent's input explained: four that swap places and wait, and what would free them."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from phalanx_explain import moments
from phalanx_explain.advice import FIELDS, PAIRS, advice, changes, frees, least_change
from phalanx_explain.costs import WISH, row_costs
from phalanx_explain.explanation import explained
from phalanx_explain.repetition import ControllerSteps, repeated

import phalanx
from phalanx.cli.app import FAILED, USAGE_ERROR, status
from phalanx.launcher.engine import EngineError
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.safety_filter import FilterInput
from tests.unit.tables import SPLIT, group, swarm_table

ACROSS = [[5.0, 0.0], [-5.0, 0.0], [0.0, 5.0], [0.0, -5.0]]
SWAP = swarm_table(
    group(
        "a b c d",
        "normal",
        ACROSS,
        law={"type": "track-velocity", "gain": 1.0},
        clock={"period": 0.05, "jitter": 0.01},
        goal=[ACROSS[k] for k in (1, 0, 3, 2)],
    ),
    function="distance",
    safety=SPLIT | {"rho": 20.0, "alpha": [3.0]},
    name="swap",
    duration=8.0,
)
ATTACK = group("z", "adversary", [[3.0, 3.0]], "pursue", speed=0.5, period=0.05)
FACING = {
    "agents.0.count": 2, "agents.0.start": [[4.0, 0, 0, 0], [-4.0, 0, 0, 0]],
    "agents.0.goal": [[-4.0, 0.0], [4.0, 0.0]], "agents.0.spread": [0, 0, 0, 0],
    "agents.0.law": {"type": "give-way", "gains": [1, 2], "speed": 3, "push": 0},
    "faults": [], "network.loss": 0,
}  # fmt: skip
"""Of two by radio, without losses."""
AGAINST = {"agents": [*SWAP["agents"], ATTACK], "network": {"loss": 0.2, "delay": 0.03}}


def recorded(name: str | Mapping[str, Any], overrides: Mapping[str, Any], end: float) -> Recording:
    scenario, records = load(name, {**overrides, "duration": end}), RecordsInMemory()
    Simulation(require_runnable(build_swarm(scenario)), records).run()
    return records.recording(scenario)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recorded run of SWAP."""
    folder = tmp_path_factory.mktemp("swap")
    Simulation(require_runnable(build_swarm(load(SWAP))), folder).run()
    return folder


@pytest.fixture(scope="module")
def swap(folder: Path) -> Recording:
    return read(folder)


@pytest.fixture(scope="module")
def waiting(swap: Recording) -> ControllerSteps:
    return repeated(swap, "a", 6.0)


@pytest.mark.slow
def test_four_that_swap_places_wait_and_the_rows_of_the_nearest_are_named(swap, waiting):
    agent, t, deadlocks = moments.stuck(swap)
    held_by = {deadlock.agent: deadlock.waits_for for deadlock in deadlocks}
    opposite, across = ["a", "b"], ["c", "d"]
    assert held_by == {"a": across, "b": across, "c": opposite, "d": opposite}
    lines = moments.who_waits(swap, deadlocks)
    assert (agent, len(lines)) == ("a", 2)
    assert lines[-1].endswith(
        '{ type = "unstick", of = { type = "track-velocity", gain = 1.0 } }\''
    )
    assert 3.0 < t < 7.0
    explanation = explained(waiting, changes=False)
    assert [row.other for row in explanation.binding] == ["c", "d"]
    words = explanation.sentences()
    assert len(words) <= 12
    assert words[0].startswith("Agent a at t = 5.9")
    assert "The row of c (half) binds: " in words[1]
    assert "for margin: sampling period" in words[1]


# Pairs of both kinds, one row of h_tot with received inputs, proven inputs, own parts.
@pytest.mark.parametrize(
    ("name", "overrides", "agent"),
    [
        (SWAP, AGAINST, "a"),
        (SWAP, {**AGAINST, "safety.information": "in-flight"}, "a"),
        (SWAP, {**AGAINST, "safety.prove": True}, "b"),
        (SWAP, {**AGAINST, "safety.information": "unknown"}, "c"),
        ("swarm2d", {}, "3"),
        ("unicycles", {}, "2"),
    ],
)
@pytest.mark.slow
def test_the_costs_of_a_row_are_those_of_the_filters_own_row(name, overrides, agent, monkeypatch):
    steps = repeated(recorded(name, overrides, 2.2), agent, 2.2)
    rows = []
    now, controller = steps.steps[-1], steps.controller
    inside = controller._filter

    def keep(of_step: FilterInput) -> Any:
        filtered = inside(of_step)
        rows.append(filtered.rows)
        return filtered

    monkeypatch.setattr(controller, "_filter", keep)
    controller(*now)
    bounds = np.atleast_1d(rows[0].bound)
    costs = row_costs(steps)
    u, u_nom = steps.result.decision.u, steps.wish
    for a, bound in zip(np.atleast_2d(rows[0].a), bounds, strict=True):
        cost = min(costs, key=lambda cost: abs(cost.bound - bound) + np.abs(cost.a - a).sum())
        scale = max(1.0, *map(abs, cost.terms.values()))
        # What separates the wish from the input in this row, but for what the input leaves of it.
        apart = float(a @ (u_nom - u))
        assert sum(cost.terms.values()) + cost.slack == pytest.approx(apart, abs=1e-9 * scale)
        assert cost.bound == pytest.approx(bound, abs=1e-9 * scale)
        assert cost.terms[WISH] == pytest.approx(float(a @ u_nom), abs=1e-9 * scale)


@pytest.mark.slow
def test_an_agent_by_radio_is_held_by_the_age_of_what_it_knows():
    steps = repeated(recorded("radio", FACING | {"network.loss": 0.7}, 3.0), "1", 3.0)
    again = row_costs(steps.under(steps.rows))  # with all that it remembers
    assert [cost.terms for cost in again] == [cost.terms for cost in row_costs(steps)]
    own_parts = [cost for cost in row_costs(steps) if cost.part == "own part"]
    (binding, *_) = own_parts
    assert binding.binds
    in_metres = binding.in_metres()
    assert in_metres["required distance"] == pytest.approx(1.0)
    assert in_metres["age of what is known"] > 1.0
    fresh = repeated(recorded("radio", FACING, 3.0), "1", 3.0)
    ages = [c.in_metres()["age of what is known"] for c in row_costs(fresh) if c.part == "own part"]
    assert max(ages) < in_metres["age of what is known"]


@pytest.mark.slow
@pytest.mark.parametrize("path", ["safety.alpha", "agents.dynamics.speed"])
def test_a_change_that_is_advised_frees_the_agent_and_a_smaller_one_does_not(waiting, path):
    (field,) = [field for field in FIELDS if field.path == path]
    assert not frees(waiting, {})
    change = least_change(waiting, field)
    assert change is not None
    assert frees(waiting, change.overrides)
    scenario = waiting.rows.swarm.scenario
    assert not frees(waiting, changes(scenario, field, 0.95 * change.share))
    assert " ".join(change.overrides) in str(change).replace("--set ", "").split("=")[0]


def test_a_change_of_a_millionth_is_as_exact_as_a_large_one(waiting, monkeypatch):
    alpha = FIELDS[0]
    scenario = waiting.rows.swarm.scenario
    (path,), least = changes(scenario, alpha, 1.0), 2.9e-6
    (bound,) = changes(scenario, alpha, least).values()
    monkeypatch.setattr("phalanx_explain.advice.frees", lambda _, values: values[path] >= bound)
    advised = least_change(waiting, alpha)
    assert least <= advised.share <= 1.03 * least


def test_a_field_that_the_scenario_lacks_is_never_advised(waiting):
    absent = [f for f in FIELDS if not changes(waiting.rows.swarm.scenario, f, 1.0)]
    assert [field.path for field in absent] == [
        "safety.eta", "agents.disturbance.bound", "agents.dynamics.wheel_rate",
        "agents.dynamics.acceleration", "agents.sensing", "safety.neighbourhood",
        "agents.radio.gain", "agents.radio.every",
    ]  # fmt: skip
    assert [least_change(waiting, field) for field in absent] == [None] * len(absent)


@pytest.mark.slow
def test_rows_that_exclude_one_another_are_named_with_what_each_would_give():
    between = {"agents.0.start": [[0.0, 0.0], [-1.3, 0.0], [1.3, 0.0], [0.0, -3.0]]}
    explanation = explained(repeated(recorded(SWAP, between, 0.1), "a", 0.0), changes=False)
    assert explanation.origin == "backup"
    assert [other for other, _ in explanation.conflict] == ["b", "c"]
    assert all(by > 0.0 for _, by in explanation.conflict)
    assert "each would have to give: b by " in explanation.sentences()[1]


@pytest.mark.slow
def test_a_given_margin_is_called_by_its_name():
    given = {"safety.margin": "paper", "safety.eta": 0.5}
    costs = row_costs(repeated(recorded(SWAP, given, 0.3), "a", 0.3))
    assert [cost.terms["margin: η as given"] for cost in costs] == [0.25] * 3
    assert all("margin: sampling period" not in cost.terms for cost in costs)
    unknown = costs[0]._replace(terms={WISH: 1.0, "margin": np.nan}, slack=np.nan)
    assert unknown.binds, "no input satisfies what is not known"


@pytest.mark.slow
def test_a_hijacked_agent_is_not_explained_by_the_input_that_it_claims():
    hijack = {"faults": [{"kind": "hijack", "agents": ["a"], "at": 0.5}]}
    with pytest.raises(EngineError, match="agent a: repeated, its controller decides otherwise"):
        repeated(recorded(SWAP, hijack, 2.0), "a", 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("t", [0.9, 0.9000000000000001, 0.9 + 5e-3])
def test_a_sample_is_explained_at_its_time_however_that_is_rounded(t):
    """The sums of periods are not the numbers that a user writes."""
    surrounded = recorded("surrounded", {}, 1.0)
    (sample,) = {s.t for s in surrounded.steps if s.agent == "1" and abs(s.t - 0.9) < 1e-9}
    assert sample > 0.9
    assert repeated(surrounded, "1", t).steps[-1].t == sample


@pytest.mark.slow
def test_what_no_row_made_has_no_explanation(swap):
    with pytest.raises(EngineError, match="expected one of a, b, c, d, got e"):
        repeated(swap, "e", 1.0)
    attacked = recorded(SWAP, AGAINST, 0.3)
    with pytest.raises(EngineError, match="agent z: expected a normal agent with rows"):
        repeated(attacked, "z", 0.3)
    with pytest.raises(EngineError, match="no agent stood for long"):
        moments.stuck(recorded(SWAP, {}, 1.0))


def test_the_worst_moment_is_where_an_input_is_farthest_from_its_wish(swap):
    agent, t = moments.worst(swap)
    away = {
        (step.agent, step.t): float(np.linalg.norm(np.subtract(step.u, step.u_nom)))
        for step in swap.steps
    }
    assert away[agent, t] == max(away.values())
    attack = msgspec.structs.replace(swap.steps[-1], origin=Origin.ATTACK, u=(99.0, 0.0))
    assert moments.worst(replace(swap, steps=[*swap.steps, attack])) == (agent, t)


@pytest.mark.slow
def test_the_command_explains_a_recorded_run(folder, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert status(["explain", str(folder), "--stuck", "--no-changes"]) == 0
    out = capsys.readouterr().out
    assert "Who waited for whom: a for c and d (" in out
    assert status(["explain", str(folder), "--stuck", "--no-changes", "--json"]) == 0
    graph = json.loads(capsys.readouterr().out)["deadlocks"]
    assert {node["agent"]: node["waits_for"] for node in graph}["c"] == ["a", "b"]
    assert "margin: sampling period" in out
    numbers_of = ["explain", str(folder), "--agent", "b", "--at", "2", "--json", "--no-changes"]
    assert status(numbers_of) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["agent"] == "b"
    assert {row["other"] for row in numbers["rows"]} == {"a", "c", "d"}
    assert status(["explain", str(folder)]) == USAGE_ERROR
    assert "expected one of --at, --worst and --stuck" in capsys.readouterr().err
    assert status(["explain", str(folder), "--at", "1"]) == USAGE_ERROR
    assert status(["explain", str(folder), "--agent", "q", "--at", "1"]) == FAILED


@pytest.mark.slow
def test_a_row_of_all_pairs_is_freed_by_one_for_each_pair_where_that_lets_the_wish_pass():
    one_row = {
        **AGAINST, "safety.composition": "lse", "safety.margin": "paper", "safety.eta": 5.0,
        "safety.information": "worst-case",
    }  # fmt: skip
    steps = repeated(recorded(SWAP, one_row, 0.6), "a", 0.6)
    assert explained(steps, changes=False).binding
    assert frees(steps, PAIRS)
    assert PAIRS in [change.overrides for change in advice(steps)]


@pytest.mark.slow
def test_advice_is_for_the_wish_that_was_recorded_whatever_the_law_remembers():
    law = {"type": "unstick", "of": SWAP["agents"][0]["law"], "patience": 0.5}
    steps = repeated(recorded(SWAP, {"agents.0.law": law}, 3.0), "d", 3.0)
    goal = np.subtract(SWAP["agents"][0]["goal"][3], steps.steps[-1].x[6:8])
    assert not np.allclose(steps.result.u_nom, goal)  # it is on a detour
    again = steps.under(steps.rows)
    assert again.result.u_nom.tolist() == steps.result.u_nom.tolist()
    assert again.result.decision.u.tolist() == steps.result.decision.u.tolist()


@pytest.mark.slow
def test_two_by_radio_stand_no_farther_apart_than_a_check_says_and_name_the_age():
    recording = recorded("radio", FACING, 7.0)
    x = recording.x[-1]
    assert 1.0 < np.linalg.norm(x[:2] - x[4:6]) < phalanx.check(recording.scenario).radio.rest
    (row,) = explained(repeated(recording, "1", 7.0), changes=False).binding
    assert (row.other, row.part) == ("2", "own part")
    assert row.in_metres()["age of what is known"] > 0.1
