"""Beliefs by radio follow again from a recording."""

import numpy as np
import pytest

import phalanx
from phalanx.recording.curves.beliefs import RecordedBeliefs
from phalanx.recording.read import read, swarm_of
from phalanx.scenario.load import load
from phalanx.swarm.statements import StatementLedger
from phalanx.swarm.swarm import build_swarm

pytestmark = pytest.mark.slow

CRASH = {"kind": "restart", "at": 0.6, "for": 0.4, "agents": ["2"]}


@pytest.fixture(scope="module")
def beliefs_of(tmp_path_factory):
    def beliefs_of(scenario, **changes):
        folder = tmp_path_factory.mktemp("run")
        loaded = phalanx.load(scenario, {"duration": 1.5, "faults": [], **changes})
        phalanx.run(loaded, engine="in-process", out=folder)
        recording = read(next(folder.iterdir()))
        return recording, RecordedBeliefs(recording, swarm_of(recording))

    return beliefs_of


def test_the_ages_are_those_that_agents_reported_and_sets_have_the_truth_in_them(beliefs_of):
    recording, beliefs = beliefs_of("radio")
    swarm, states = swarm_of(recording), dict(zip(recording.times, recording.x, strict=True))
    for step in recording.steps[::20]:
        i = swarm.names.index(step.agent)
        believed, truth = beliefs.at(i, step.t), swarm.positions(states[step.t])
        reported = {swarm.names.index(name): age for name, age in step.ages}
        assert {b.peer: b.age for b in believed if b.used} == reported
        assert all((b.corners[0] - 1e-9 <= truth[b.peer]).all() for b in believed)
        assert all((truth[b.peer] <= b.corners[1] + 1e-9).all() for b in believed)
    assert any(news.relayed for news in beliefs.news[0])
    oldest = {l: series.y.max() for l, series in beliefs.ages(0).items()}
    ages = [dict(step.ages) for step in recording.steps if step.agent == "1"]
    assert oldest == {l: max(a.get(str(l + 1), 0.0) for a in ages) for l in range(1, 8)}


def test_one_that_was_restarted_knows_nothing_until_it_hears_again(beliefs_of):
    _, beliefs = beliefs_of("radio", faults=[CRASH])
    known = [len(beliefs.at(1, t)) for t in (0.5, 1.001, 1.49)]
    assert known[0] == 7
    assert known[1] == 0
    assert known[2] > 0


def test_a_baseline_believes_one_state_which_is_old(beliefs_of):
    recording, beliefs = beliefs_of("radio-naive")
    for belief in beliefs.at(0, 1.2):
        np.testing.assert_array_equal(belief.corners, [belief.centre] * 2)
        then = recording.x[np.searchsorted(recording.times, 1.2 - belief.age)]
        heard = swarm_of(recording).positions(then)[belief.peer]
        np.testing.assert_allclose(belief.centre, heard, atol=0.1)
        assert belief.age > 0.0


def test_one_without_a_radio_may_be_restarted():
    swarm = build_swarm(load("warehouse-radio"))
    ledger = StatementLedger(swarm)
    before = {i: dict(known) for i, known in ledger.known.items()}
    (truck,) = (i for i, name in enumerate(swarm.names) if name == "truck")
    ledger.restarted(truck)
    assert ledger.known == before
