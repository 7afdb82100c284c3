"""The log of events, and the trajectory's hash, which knows every last bit of states and inputs."""

from pathlib import Path

import numpy as np
import pytest
from phalanx_certify.checker.certify import certify
from phalanx_certify.checker.intervals import UncertifiableError
from phalanx_plant.judge.judge import Judged
from phalanx_plant.observers.recorder import TrajectoryHash
from phalanx_plant.world.events import InputApplied, StateReached

import phalanx
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.swarm.swarm import build_swarm
from tests.unit.tables import group, swarm_table

LINE = {"obstacles": [{"center": [0.0, 5.0], "clearance": 3.0}], "safety": {"eta": 0.0}}


@pytest.mark.slow
def test_the_log_names_each_pair_that_leaves_not_the_one_that_was_worst_before(tmp_path: Path):
    """The obstacle is intruded upon most deeply, and from the start; the pair leaves later."""
    # An agent that cannot move is caught.
    hunted = group("hunted", "normal", [[0.0, 2.5]], "track-velocity", speed=1e-3)
    hunter = group("hunter", "adversary", [[2.5, 2.5]], "pursue")
    scenario = phalanx.load(swarm_table(hunted, hunter, **LINE))
    run = phalanx.run(scenario, engine="in-process", out=tmp_path)
    exits = run.events.filter(run.events["text"].str.contains("left the safe set"))
    assert exits["text"].to_list() == [
        "hunted-obstacle 0 left the safe set",
        "hunted-hunter left the safe set",
    ]
    assert exits["t"][0] == 0.0 < exits["t"][1]
    assert {v.pair for v in run.summary.violations} == {"hunted-obstacle 0", "hunted-hunter"}
    assert run.summary.worst_pair == "hunted-obstacle 0"


@pytest.mark.slow
def test_a_backup_is_a_step_at_which_the_backup_input_was_applied():
    """Steps with empty K_i that kept the nominal input are none."""
    scenario = phalanx.load("unicycles", {"duration": 0.5, "safety.eta": 40.0})
    run = phalanx.run(scenario, engine="in-process")
    counted = dict(run.inputs["origin"].value_counts().iter_rows())
    assert counted["no-authority"] > 0
    assert run.summary.origins["backup"] == counted["backup"] > 0


@pytest.mark.slow
def test_states_are_recorded_no_more_often_than_asked_for_and_no_peak_is_lost():
    whole = phalanx.run(phalanx.load("unicycles", {"duration": 0.3}), engine="in-process")
    thinned = phalanx.load("unicycles", {"duration": 0.3, "time.recording_step": 0.03})
    run = phalanx.run(thinned, engine="in-process")
    assert run.summary.trajectory == whole.summary.trajectory
    *steps, _ = run.states["t"].diff().drop_nulls()
    assert min(steps) >= 0.03
    assert run.states["t"][-1] == 0.3, "the end of the run"
    assert 7 < len(run.states) <= 11
    for t, x in run.states.select("t", "1.x").iter_rows():
        assert whole.states.filter(whole.states["t"] == t)["1.x"].to_list() == [x]
    bounds = [-1.0, *run.states["t"]]
    for begin, end, peak in zip(bounds[:-1], bounds[1:], run.states["h_tot"], strict=True):
        since = whole.states.filter((whole.states["t"] > begin) & (whole.states["t"] <= end))
        assert peak == since["h_tot"].max()
    with pytest.raises(UncertifiableError, match="in a state not recorded"):
        certify(run.scenario, run.recording.states, run.recording.steps)


def certified(run: phalanx.Run) -> set[float]:
    """The recorded certificates, which must be those of the true states of the inputs."""
    swarm, recording, times = build_swarm(run.scenario), run.recording, set()
    certificates, states = SwarmCertificates(swarm), {s.t: np.array(s.x) for s in recording.states}
    for step in recording.steps:
        i = swarm.names.index(step.agent)
        if i in swarm.normal:
            proven = certificates.of(i)(states[step.t_apply], np.array(step.u))
            assert step.certified == proven.min()
            times.add(step.certified)
    return times


@pytest.mark.slow
@pytest.mark.parametrize("latency", [0.0, 0.004])
def test_each_input_is_certified_from_the_state_in_which_it_took_effect(latency: float):
    start = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.0, 1.2, 0.0]]
    close = {"agents.0.start": start, "agents.0.spread": [0.0, 0.0, 0.0]}
    settings = {"duration": 0.3, "time.latency": latency, **close}
    run = phalanx.run(phalanx.load("unicycles", settings), engine="in-process")
    assert len(certified(run)) > 20


@pytest.mark.slow
def test_an_agent_from_far_away_counts_in_certificates_when_it_is_near():
    """The pairs that may meet are not looked up at each input."""
    hunted = group("hunted", "normal", [[0.0, 0.0]], "track-velocity", speed=1e-3)
    hunter = group("hunter", "adversary", [[2.5, 0.0]], "pursue")
    run = phalanx.run(phalanx.load(swarm_table(hunted, hunter, **LINE)), engine="in-process")
    times = certified(run)
    assert min(times) == 0.0
    assert len(times) > 3


def hashed(x: float = 1.0, u: float = 0.5, i: int = 0, k: int = 3, t: float = 0.1) -> str:
    trajectory = TrajectoryHash()
    state = np.full(15, x)
    applied = InputApplied(i, k, t, t, np.array([u, 0.0]))
    trajectory.add([Judged(StateReached(t, state, [])), Judged(applied)])
    return trajectory.hexadecimal


def test_the_hash_changes_with_the_last_bit_of_any_state_or_input_with_agent_step_and_time():
    up = np.nextafter
    changed = [hashed(x=up(1.0, 2)), hashed(u=up(0.5, 1)), hashed(t=up(0.1, 1)), hashed(i=1)]
    assert len({hashed(), hashed(k=4), *changed}) == 6


def test_the_same_events_have_the_same_hash():
    assert hashed() == hashed()
