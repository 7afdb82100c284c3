"""Agents that prove their inputs: certified ones stay as they are, others are replaced."""

from collections import Counter

import casadi as ca
import numpy as np
import pytest
from phalanx_agent.controller import DistributedController

import phalanx
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.proven_filter import ProvenFilter
from phalanx.network.draws import Draws
from phalanx.scenario.load import load, read_table
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.safety_filter import FilterInput

# A margin of 0 proves nothing, so that some inputs are certified for too short a time.
PAIRS = {"safety.composition": "pairs", "safety.eta": 0.0}
HIJACK = [{"kind": "hijack", "at": 6.0, "agents": ["2"]}]


class Forwards(Unicycle):
    """It cannot go backwards: the middle of its inputs is not nought."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        A, b = super().input_polytope(x)
        return ca.vertcat(A, ca.SX([[-1.0, 0.0]])), ca.vertcat(b, 0.0)


def controllers(changes: dict[str, object]) -> list[DistributedController]:
    """Agent 1 of Simulation 1, without and with proofs."""
    both = (load("unicycles", {**changes, "safety.prove": prove}) for prove in (False, True))
    return [DistributedController(build_rows(build_swarm(each)), 0) for each in both]


@pytest.mark.slow
@pytest.mark.parametrize(("information", "near"), [("split", [1]), ("unknown", [3, 4])])
def test_an_input_that_is_certified_for_too_short_is_replaced_by_a_longer_one(information, near):
    """Agent 2 keeps the other half of the pair's row, agents 4 and 5 are adversaries."""
    own = {"type": f"{__name__}:Forwards", "speed": 4.0, "turn_rate": 2.0, "offset": 0.25}
    changes = {**PAIRS, "safety.information": information, "agents.0.dynamics": own}
    plain, proving = controllers(changes)
    swarm = build_swarm(load("unicycles", changes))
    agent, start = SwarmCertificates(swarm).of(0), swarm.start()
    draws, visible = Draws(5, "crowded", width=5), tuple(range(5))
    origins: Counter[Origin] = Counter()
    begins = [part.start for part in swarm.safe_set.parts]
    corners = build_rows(swarm).terms(0)(start, visible).polytopes[0].corners
    for k in range(200):
        # They are close, on any side of each other: most are nearly unsafe, but not yet.
        x, (far, angle, *turned, _) = start.copy(), draws[k].tolist()
        x[begins[0] + 2] = 6.3 * turned[0]
        distance = (0.99 + 0.1 * far) * np.array([np.cos(6.3 * angle), np.sin(6.3 * angle)])
        # Positions are those of output points, 0.25 m ahead of the states.
        mine, its = (0.25 * np.array([np.cos(6.3 * t), np.sin(6.3 * t)]) for t in turned)
        for l, side in zip(near, (1.0, -1.0), strict=False):
            position = x[begins[0] : begins[0] + 2] + mine - its + side * distance
            x[begins[l] : begins[l] + 3] = *position, 6.3 * turned[1]
        first, second = (c(x, visible, float(k), {}).decision for c in (plain, proving))
        before, after = (float(agent(x, d.u).min()) for d in (first, second))
        assert second.proven == after
        origins[second.origin] += 1
        if second.origin is Origin.PROVEN:
            assert before < agent.tau <= after
            continue
        if second.origin is Origin.LONGEST:
            assert before < min(agent.tau, after)
        else:
            assert (second.u == first.u).all()
            assert second.origin == first.origin
            if before >= agent.tau:
                continue
        # Nothing tried at first is certified for longer, nor halfway from the best of it.
        tried = [first.u, *corners, np.mean(corners, axis=0)]
        best = max(tried, key=lambda u: float(agent(x, u).min()))
        halfway = [0.5 * (best + u) for u in tried]
        assert max(float(agent(x, u).min()) for u in halfway) <= after
    assert origins[Origin.LONGEST] > 3


def test_only_a_pair_that_its_half_row_leaves_unproven_gets_its_whole_row():
    """Agent 2 may be met before the next sample, agent 3 not; none of the three moves."""
    table = read_table("one-on-one")
    starts = {"1": [0.0, 0.0], "2": [1.01, 0.0], "3": [0.0, -1.2]}
    first = table["agents"][0]
    table["agents"] = [first | {"names": [n], "start": [x]} for n, x in starts.items()]
    options = {**PAIRS, "safety.information": "split", "safety.alpha": [5.0]}
    rows, seen = build_rows(build_swarm(load(table, options))), (0, 1, 2)
    x, plain = rows.swarm.start(), rows.filter(0)
    now = FilterInput(0.0, x, seen, rows.terms(0)(x, seen), np.array([1.0, -0.3]), {})
    half, decision = plain(now).decision, ProvenFilter(rows, 0, plain)(now).decision
    assert decision.origin is Origin.PROVEN
    assert half.u == pytest.approx([2.5 * (1.01**2 - 1.0) / 2.02, -0.3])
    inside = 5.0 * (1.01**2 - 1.0) / 2.02 - 1.0 - 1e-6
    assert decision.u == pytest.approx([inside, -0.3], abs=1e-9)
    assert decision.binding == (1,)
    assert decision.proven == SwarmCertificates(rows.swarm).of(0)(x, decision.u).min()
    one_row = {"safety.composition": "lse", "safety.information": "worst-case"}
    rows = build_rows(build_swarm(load(table, options | one_row)))
    now = FilterInput(0.0, x, seen, rows.terms(0)(x, seen), np.array([1.0, -0.3]), {})
    proving, first = ProvenFilter(rows, 0, rows.filter(0)), rows.filter(0)(now)
    of_agent_3 = proving._with_whole_rows(now, first, proving.proofs.others == 2)
    assert of_agent_3.decision.binding == first.decision.binding == (1,)


@pytest.mark.slow
def test_quiet_pairs_are_looked_at_again_while_their_proof_lasts_as_long_as_an_input():
    rows = build_rows(build_swarm(load("guaranteed")))
    far, tau = rows.swarm.start(), rows.swarm.horizon(0)
    own, other = (rows.swarm.safe_set.parts[l] for l in (0, 3))
    close = far.copy()
    close[other.start] = close[own.start] + 1.2
    close[other.start + 1] = close[own.start + 1]
    visible = tuple(range(5))
    for later, looked in ((14.9, False), (15.1, True)):
        proofs = ProvenFilter(rows, 0, rows.filter(0)).proofs
        assert proofs.near(FilterInput(0.0, far, visible, None, np.zeros(2), {})) is None
        near = proofs.near(FilterInput(later * tau, close, visible, None, np.zeros(2), {}))
        assert (near is not None) == looked


@pytest.mark.slow
@pytest.mark.parametrize(("later", "is_looked_at"), [(6.9, False), (7.1, True)])
def test_a_pair_is_proven_no_longer_because_another_pair_is_looked_at(later, is_looked_at):
    """Agent 4 is near agent 1 all the time; agent 5 comes near while its pair is still proven."""
    rows = build_rows(build_swarm(load("guaranteed")))
    parts, x, tau = rows.swarm.safe_set.parts, rows.swarm.start(), rows.swarm.horizon(0)

    def near_agent_1(x: np.ndarray, l: int, side: float) -> np.ndarray:
        x = x.copy()
        x[parts[l].start : parts[l].start + 2] = x[parts[0].start : parts[0].start + 2]
        x[parts[l].start] += 1.2 * side
        return x

    proofs, visible = ProvenFilter(rows, 0, rows.filter(0)).proofs, tuple(range(5))
    four = near_agent_1(x, 3, 1.0)
    first = proofs.near(FilterInput(0.0, four, visible, None, np.zeros(2), {}))
    assert first is not None
    assert proofs.others[first.pairs].tolist() == [3]
    both = near_agent_1(four, 4, -1.0)
    second = proofs.near(FilterInput(later * tau, both, visible, None, np.zeros(2), {}))
    assert second is not None
    assert (4 in proofs.others[second.pairs]) == is_looked_at


@pytest.mark.slow
def test_who_comes_into_sight_for_another_is_not_proven_as_that_one_was():
    """Agent 5 goes out of sight far away and agent 4 comes near, or the other way round."""
    rows = build_rows(build_swarm(load("guaranteed")))
    parts, x = rows.swarm.safe_set.parts, rows.swarm.start()
    for gone, comes in ((4, 3), (3, 4)):
        proofs, close = ProvenFilter(rows, 0, rows.filter(0)).proofs, x.copy()
        assert proofs.near(FilterInput(0.0, x, (0, gone), None, np.zeros(2), {})) is None
        close[parts[comes].start : parts[comes].start + 2] = x[:2] + np.array([1.2, 0.0])
        near = proofs.near(FilterInput(0.01, close, (0, comes), None, np.zeros(2), {}))
        assert near is not None
        assert proofs.others[near.pairs].tolist() == [comes]


@pytest.mark.parametrize("number", range(3))
def test_one_who_sees_no_other_proves_pairs_with_the_obstacle_that_is_near(number):
    swarm = build_swarm(load("guaranteed"))
    rows, obstacle = build_rows(swarm), swarm.safe_set.obstacles[number]
    x = np.full_like(swarm.start(), np.nan)
    x[:3] = *(obstacle.center + np.array([obstacle.clearance + 0.1, 0.0])), 0.0
    proofs = ProvenFilter(rows, 0, rows.filter(0)).proofs
    near = proofs.near(FilterInput(0.0, x, (0,), None, np.zeros(2), {}))
    assert near is not None
    assert proofs.others[near.pairs].tolist() == [5 + number]


@pytest.mark.nightly
@pytest.mark.slow
def test_with_proofs_a_hijack_leaves_the_remaining_pairs_guaranteed():
    ends = {}
    for prove in (False, True):
        changes = {"safety.information": "worst-case", "safety.prove": prove, "duration": 14.0}
        scenario = phalanx.load("unicycles", {**changes, "faults": HIJACK})
        ends[prove] = phalanx.run(scenario, engine="in-process")
    assert ends[False].verdict is phalanx.Outcome.VIOLATED
    assert ends[True].verdict is phalanx.Outcome.GUARANTEED
    assert ends[True].summary.origins[Origin.LONGEST] > 10
    assert Origin.LONGEST not in ends[False].summary.origins
    proven = ends[True].inputs.filter(agent="1")["proven"]
    assert np.isfinite(proven.drop_nulls().to_numpy()).all()
    assert len(proven.drop_nulls()) == len(proven)


class SlowNearBorders(SingleIntegrator):
    """A single integrator whose inputs depend on its state, so that no pair with it is proven."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        A, b = super().input_polytope(x)
        return A, b / (1.0 + x[0] ** 2)


@pytest.mark.slow
def test_one_whose_pairs_cannot_be_proven_does_not_keep_an_agent_from_proving_others():
    b_starts_at_5_4 = {
        "names": ["b"], "role": "adversary", "start": [[5.0, 4.0]], "spread": [],
        "dynamics": {"type": f"{__name__}:SlowNearBorders", "speed": 1.0},
    }  # fmt: skip
    table = read_table("one-on-one")
    table["agents"].append({**table["agents"][1], **b_starts_at_5_4})
    scenario = load(
        {**table, "duration": 1.5},
        {"safety.prove": True, "safety.eta": 0.0, "safety.alpha": [20.0]},
    )
    result = phalanx.run(scenario, engine="in-process")
    assert result.verdict is not phalanx.Outcome.BROKEN
    assert result.summary.origins[Origin.LONGEST] > 10
    assert set(result.inputs.filter(agent="1")["proven"]) == {0.0}


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"time.latency": 0.002}, "time.latency"),
        ({"safety.control": "centralised", "safety.information": "paper"}, "safety.prove"),
    ],
)
def test_proofs_need_inputs_that_apply_at_the_sample_and_agents_that_decide(changes, where):
    with pytest.raises(ScenarioError, match=where):
        load("unicycles", {"safety.prove": True, **changes})


@pytest.mark.slow
def test_an_input_to_be_proven_keeps_off_its_rows_so_that_rounding_does_not_decide():
    """On its row an input leads to h = 0, where nothing is proven and h > 0 is a rounding away."""
    options = {"safety.prove": True, "safety.eta": 0.0, "safety.alpha": [20.0], "duration": 2.5}
    summary = phalanx.run(load("one-on-one", options), engine="in-process").summary
    assert summary.outcome is phalanx.Outcome.SAFE
    assert summary.worst_h < -5e-8
    assert summary.origins[Origin.LONGEST] > 100
