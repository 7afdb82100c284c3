"""Agents that read no role: relabelled swarms give the same inputs, to the bit."""

from collections.abc import Iterator

import numpy as np
import pytest
from phalanx_agent.controller import DistributedController

from phalanx.guarantee.check import check
from phalanx.network.draws import Draws
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from tests.unit.tables import group, swarm_table

FORMATION = {"path": [[0.0, 0.0], [4.0, 0.0], [6.0, 0.0], [9.0, 0.0]], "finish": 2.0,
             "radius": 1.5, "slots": 4}  # fmt: skip


def rows_with(roles: str, composition: str, law: str = "track-velocity") -> SafetyRows:
    """Agents "1", "2", ... with these roles, "n" or "a"; faster ones have higher numbers."""
    agents = []
    for slot, role in enumerate(roles):
        name = {"n": "normal", "a": "adversary"}[role]
        unicycle = {"type": "unicycle", "speed": 2 + slot, "turn_rate": 2.0, "offset": 0.25}
        agents.append(group(str(slot + 1), name, [], law, dynamics=unicycle, slots=[slot]))
        agents[-1] |= {"clock": {"period": 0.01, "jitter": 0.002}}
        agents[-1] |= {"disturbance": {"bound": 0.3, "every": 0.1}}
        del agents[-1]["start"]  # it starts in its slot
    safety = {"alpha": [10.0], "information": "unknown", "composition": composition}
    safety |= {"margin": "local"} if composition == "pairs" else {"eta": 1.0}
    sphere = {"center": [3.0, 1.0], "clearance": 0.5}
    table = swarm_table(*agents, safety=safety, formation=FORMATION, obstacles=[sphere])
    return build_rows(build_swarm(load(table)))


def crowded_states(rows: SafetyRows) -> Iterator[np.ndarray]:
    """States around the start, some with agents near enough for their rows to bind."""
    start = rows.swarm.start()
    draws = Draws(3, "relabelled", width=len(start))
    for k in range(40):
        yield 0.7 * start + 0.5 * (2.0 * draws[k] - 1.0)


def inputs(rows: SafetyRows) -> list[bytes]:
    controller = DistributedController(rows, 0)
    everyone = tuple(range(len(rows.swarm.members)))
    return [
        controller(x, everyone, 0.02 * k, {}).decision.u.tobytes()
        for k, x in enumerate(crowded_states(rows))
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("composition", "law"),
    [
        *(("pairs", "pursue"), ("lse", "track-velocity")),
        pytest.param("pairs", "track-velocity", marks=pytest.mark.nightly),
        pytest.param("lse", "pursue", marks=pytest.mark.nightly),
    ],
)
def test_an_agents_inputs_do_not_depend_on_the_roles_of_others(composition, law):
    first = inputs(rows_with("nnnn", composition, law))
    assert len(set(first)) > 2
    for roles in ("naaa", "nnaa", "nana", "naan"):
        assert inputs(rows_with(roles, composition, law)) == first


def test_rows_bind_at_some_of_these_states_so_that_roles_could_have_mattered():
    rows = rows_with("nnnn", "pairs")
    controller = DistributedController(rows, 0)
    results = [controller(x, (0, 1, 2, 3), 0.0, {}) for x in crowded_states(rows)]
    changed = [not np.allclose(step.decision.u, step.u_nom) for step in results]
    assert sum(changed) > 5


def test_an_agent_composes_its_own_pairs_alone():
    rows = rows_with("nnna", "lse")
    view = rows.seen_by(1).swarm.safe_set
    assert [view.label(pair) for pair in view.pairs] == ["2-1", "2-3", "2-4", "2-obstacle 0"]
    adversary = rows.seen_by(3)
    assert adversary is rows


def test_agents_with_equal_pairs_share_what_is_compiled():
    rows = build_rows(build_swarm(load("guaranteed", {"safety.information": "unknown"})))
    x = rows.swarm.start()
    for i in rows.swarm.normal:
        rows.seen_by(i).pair_terms(i)(x)
    kinds = sum(key[0] == "row" for key in rows.swarm.functions.results)
    assert kinds == 3  # a normal agent, an adversary, an obstacle


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("name", ["unicycles", "guaranteed"])
def test_check_says_whether_a_swarm_can_start_and_what_it_costs(name):
    report = check(load(name, {"safety.information": "unknown"}))
    assert all(report.rows_at_start.values())
    assert any("everyone else at worst" in words for words in report.words)


@pytest.mark.parametrize(
    ("scenario", "changes", "why"),
    [
        ("heading-aware", {}, "depends on declared roles"),
        ("unicycles", {"safety.control": "centralised"}, "knows whom it controls"),
    ],
)
def test_what_reads_roles_is_refused(scenario, changes, why):
    with pytest.raises(ScenarioError, match=why):
        load(scenario, {"safety.information": "unknown", **changes})
