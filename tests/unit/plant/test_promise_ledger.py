"""The judge's ledger of promises: what breaks one breaks that of its agent, at its time."""

import numpy as np
import pytest
from phalanx_plant.judge.judge import Judge
from phalanx_plant.judge.promise import PromiseLedger
from phalanx_plant.world.events import Event, InputApplied, Sampled, StateReached
from phalanx_plant.world.world import DisturbanceKnot

from phalanx.guarantee.verdict import BrokenPromise, Violation
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from tests.unit.plant.runs import report
from tests.unit.promise.test_runs import DOUBLE, scenario


def ledger(**changes) -> PromiseLedger:
    return PromiseLedger(build_swarm(scenario(**changes)))


def broken(promises: PromiseLedger, t: float = 0.0) -> list[BrokenPromise]:
    return promises.summary(t, []).broken


@pytest.mark.parametrize(("changes", "counts"), [(DOUBLE, True), ({}, False)])
def test_a_sample_that_comes_early_or_late_breaks_what_its_agent_keeps(changes, counts):
    promises = ledger(**changes)
    # A first sample is early for none; b's third comes after 0.02 s.
    for i, t in ((0, 0.01), (1, 0.0625), (0, 0.0625), (1, 0.125), (0, 0.125), (1, 0.145)):
        promises.sampled(i, t)
    early = BrokenPromise("b", 0.145, "a sample came early")
    assert broken(promises, 0.145) == ([early] if counts else [])
    promises.sampled(0, 0.2)
    promises.fell_silent(1)
    late = BrokenPromise("a", 0.125 + 0.07, "a sample came late")
    silent = BrokenPromise("b", 0.145 + 0.07, "it fell silent")
    assert broken(promises, 0.25) == ([early, late] if counts else [late, silent])


def test_of_an_adversary_and_of_one_that_turned_nothing_is_checked():
    promises = ledger()
    promises.turned(1, 0.03)
    promises.turned(1, 0.04)
    promises.disturbed(DisturbanceKnot(0.05, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])))
    promises.applied(InputApplied(1, 0, 0.05, 0.5, np.ones(2)), np.zeros(7), truthful=True)
    promises.applied(InputApplied(2, 0, 0.05, 0.5, np.ones(2)), np.zeros(7), truthful=True)
    promises.lost(1, 0.05)
    summary = promises.summary(0.07, [])
    assert str(summary) == (
        "kept for 3 of 3 pairs (1 for ever, 2 passively); turned, and promised nothing since: "
        "b at 0.030 s"
    )
    assert broken(promises, 0.08) == [BrokenPromise("a", 0.07, "a sample came late")]


@pytest.mark.parametrize(
    ("phi", "agents"),
    [
        ([0.03, 0.04, 0.0, 0.05, 0.0, 0.0, 0.0], ""),
        ([0.03, 0.04, 0.04, 0.04, 0.0, 0.0, 0.0], "b"),
        ([np.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "a"),
        ([0.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0], "ab"),
    ],
)
def test_a_disturbance_above_its_bound_breaks_its_agents_promise_an_adversarys_all(phi, agents):
    promises, culprit = ledger(), {"ab": "rogue"}.get(agents, agents)
    promises.disturbed(DisturbanceKnot(0.0625, np.array(phi)))
    why = f"the disturbance of {culprit} is above its bound"
    first = [BrokenPromise(name, 0.0625, why) for name in agents]
    assert broken(promises) == first
    promises.failed(0.07, "a wall fell")
    rest = [BrokenPromise(name, 0.07, "a wall fell") for name in "ab" if name not in agents]
    assert broken(promises) == first + rest


def test_the_judge_breaks_promises_by_true_states_and_inputs_and_says_culprit_sample_was_false():
    judge, x = Judge(build_rows(build_swarm(scenario()))), build_swarm(scenario()).start()
    x[:4] = [-0.51, 0.0, 0.51, 0.0]
    events: list[Event] = [StateReached(0.0625, x, [])]
    for i, u, late in ((0, 0.0, 0.0), (1, -1.0, 0.0), (0, 0.0, 1e-3)):
        u, taken = np.array([u, 0.0]), Sampled(i, 0.0625, truthful=i == 0)
        events += [taken, InputApplied(i, 0, 0.0625, 0.0625 + late, u, telemetry=report(0))]
    judge.judge(events, [])
    promise = judge.findings().promise
    false = "an input that the rule does not let through: its sample was false"
    assert promise.broken == [
        BrokenPromise("b", 0.0625, false), BrokenPromise("a", 0.0625, "an input came late"),
    ]  # fmt: skip
    assert str(promise) == (
        "kept for 0 of 5 pairs (0 for ever, 0 passively); broken at 0.062 s by b: "
        f"{false} and 1 more"
    )
    promise.broken.pop()
    assert str(promise).endswith(false)


@pytest.mark.parametrize("restarts", [True, False])
def test_a_new_process_begins_to_hold_where_it_is(restarts):
    """So near to b nothing else is let through. The old process goes back to where it began."""
    promises, x = ledger(), build_swarm(scenario()).start()
    x[:4] = [-0.375, 0.0, 0.375, 0.125]
    promises.applied(InputApplied(0, 0, 0.0, 0.0, np.zeros(2)), x, truthful=True)
    x[0] += 0.015625
    if restarts:
        promises.restarted(0)
    promises.applied(InputApplied(0, 1, 0.05, 0.05, np.zeros(2)), x, truthful=True)
    why = "an input that the rule does not let through"
    assert broken(promises) == ([] if restarts else [BrokenPromise("a", 0.05, why)])


def ledger_after(t: float) -> PromiseLedger:
    """A judge's, when a has moved by an input that it may apply, and then stood from t on."""
    promises, x = ledger(), build_swarm(scenario()).start()
    for at, u in ((0.0, [0.1, 0.0]), (t, [0.0, 0.0])):
        promises.sampled(0, at)
        promises.applied(InputApplied(0, 0, at, at, np.array(u)), x, truthful=True)
    return promises


@pytest.mark.parametrize(("at", "broken"), [(0.02, True), (0.06, False)])
def test_an_agent_that_is_hit_while_it_moves_breaks_its_promise(at, broken):
    hit = Violation("a-rogue", at, 0.1, at, 0.01, 1, at, None)
    summary = ledger_after(0.05).summary(0.1, [hit])
    why = [b for b in summary.broken if b.agent == "a"]
    assert [b.why for b in why] == (["a-rogue was unsafe"] if broken else [])


def test_an_unsafe_pair_breaks_what_was_promised_for_ever_at_any_speed():
    hit = Violation("a-obstacle 0", 0.08, 0.1, 0.08, 0.01, 1, 0.08, None)
    (broken,) = [b for b in ledger_after(0.05).summary(0.1, [hit]).broken if b.agent == "a"]
    assert broken.why == "a-obstacle 0 was unsafe"
