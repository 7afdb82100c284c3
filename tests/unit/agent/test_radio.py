"""Peers by radio: they are in no sample, and known by states and relays in broadcasts."""

import itertools
from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np
import pytest
from phalanx_agent.step import ControlStep
from phalanx_plant.sampling.sampling import Sampling

import phalanx
from phalanx.launcher.simulation import Simulation
from phalanx.messages.kinds import Broadcast, Sample
from phalanx.messages.seal import Malformed
from phalanx.network.inbox import BroadcastInbox, Statement
from phalanx.network.link import Link
from phalanx.report.write import origins
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.radio import PeerKnowledge, gain
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.laws.law import View
from tests.unit.network.models import model
from tests.unit.swarms import rows_of_scenario, swarm_of_scenario

EVERYBODY = tuple(range(8))


def belief(name: str) -> tuple[str, ...]:
    return (f"agents.0.radio.belief={name}", "agents.0.radio.rows=halves")


def statement(sender: int, k: int, x: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0)) -> Statement:
    return Statement(sender=sender, k=k, t_apply=0.1 * k, u=(1.0, -1.0), t=0.1 * k, x=x, z=x)


def broadcast(k: int, *relays: Statement, x: tuple[float, ...] = (0.0,) * 4) -> Broadcast:
    return Broadcast(k=k, t_apply=0.1 * k, u=(0.0, 0.0), t=0.1 * k, x=x, z=x, relays=relays)


def sample(k: int, *senders: int) -> Sample:
    """Agent 1's k-th, at 0.1 k, with the first broadcast of these senders."""
    x, zeros = np.zeros(4).tobytes(), (0,) * len(senders)
    return Sample(
        k=k, t=0.1 * k, seen=(0,), x=x, senders=senders, since=zeros, latest=zeros,
        hearers=EVERYBODY[1:], distances=(2.0,) * len(senders),
    )  # fmt: skip


def test_an_agent_sees_no_peer_and_all_peers_get_each_tenth_broadcast_at_any_distance():
    swarm = swarm_of_scenario("radio")
    sampling, x = Sampling(swarm), 1e4 * swarm.start()
    p = swarm.positions(x)
    for k in range(21):
        (visible,) = sampling.sensing.visible(p, [0])
        taken, _ = sampling.take(0, 0.035 * k, x, visible)
        assert taken.seen == (0,)
        assert taken.hearers == (EVERYBODY[1:] if k % 10 == 0 else ())
    (visible,) = sampling.sensing.visible(p, [3])
    taken, _ = sampling.take(3, 1.0, x, visible)
    assert (taken.senders, taken.since, taken.latest) == ((0,), (0,), (20,))
    assert taken.distances == (float(np.linalg.norm(p[0] - p[3])),)


def test_an_inbox_keeps_the_newest_statement_direct_or_relayed():
    links = model()
    inbox = BroadcastInbox((1, 2), lambda j: Link(0, str(j), "me", links), peers={1: 5, 2: 5})
    inbox.put(1, broadcast(0))
    inbox.put(2, broadcast(5, statement(1, 5), statement(7, 5)))
    inbox.put(2, broadcast(10, statement(1, 0)))
    assert not inbox.lacks({1: (0, 0), 2: (1, 10)}), "only each fifth sample has a broadcast"
    assert inbox.missing({1: (0, 9)}) == {1: [5]}
    inbox.advance({1: (0, 0), 2: (1, 10)}, 1.6)
    assert {l: s.k for l, s in inbox.received.items()} == {1: 5, 2: 10}
    of_the_future = [msgspec.structs.replace(statement(1, 99), t=t) for t in (0.6, 1.7)]
    inbox.put(2, broadcast(15, statement(1, 10), *of_the_future))
    inbox.advance({1: (0, 0), 2: (1, 15)}, 1.6)
    assert inbox.received[1].k == 10, "neither a time nor a number of the future counts"


@pytest.mark.slow
def test_a_burst_is_of_so_many_broadcasts_in_a_row_however_rare_these_are():
    bursts = model(loss={"mean": 0.4, "burst": 8.0})
    inbox = BroadcastInbox((1,), lambda j: Link(0, "1", "me", bursts), peers={1: 5})
    for k in range(0, 200_000, 5):
        inbox.put(1, Broadcast(k=k, t_apply=1e-3 * k, u=()))
    lost = [fate.delay < 0.0 for fate in inbox.advance({1: (0, 199_999)}, 1e3)]
    begins = sum(now and not before for before, now in itertools.pairwise(lost))
    assert sum(lost) / begins == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize(("peers", "known"), [({}, {2}), ({1: 1, 2: 1}, {1, 2})])
def test_what_a_peer_said_is_not_forgotten_when_its_broadcasts_count_no_more(peers, known):
    inbox = BroadcastInbox((1, 2), lambda j: Link(0, str(j), "me", model()), peers)
    for sender in (1, 2):
        inbox.put(sender, broadcast(0))
    inbox.advance({1: (0, 0), 2: (0, 0)}, 1.0)
    inbox.advance({2: (0, 0)}, 2.0)
    assert set(inbox.received) == known


@pytest.mark.parametrize(
    "spoilt",
    [
        broadcast(10, x=(0.0,) * 3),
        msgspec.structs.replace(broadcast(10), z=(0.0,) * 3),
        broadcast(10, statement(9, 0)),
        broadcast(10, statement(2, 0, x=(0.0,) * 6)),
        broadcast(10, statement(2, 10**6)),
        broadcast(10, *[statement(2, k) for k in range(8)]),
    ],
    ids=["own state", "reference", "of nobody", "another size", "the future", "too many relays"],
)
def test_a_broadcast_that_its_sender_cannot_make_is_refused(spoilt: Broadcast):
    step = ControlStep(rows_of_scenario("radio"), 0)
    with pytest.raises(Malformed, match="wrong size"):
        step.accept_broadcast("2", spoilt)
    step.accept_broadcast("2", broadcast(10, statement(3, 0)))


def test_a_broadcast_carries_the_state_and_what_was_heard_the_newest_first():
    perfect = "network.loss=0", "faults=[]"
    step = ControlStep(rows_of_scenario("radio", "agents.0.radio.relays=2", *perfect), 0)
    first = step(step.accept_sample(sample(0)))
    assert first.broadcasts[3].x == (0.0,) * 4
    assert first.broadcasts[3].relays == ()
    for j, k in (1, 0), (2, 10), (3, 20):
        step.accept_broadcast(step.swarm.names[j], broadcast(k, x=(float(j),) * 4))
    heard = msgspec.structs.replace(
        sample(1, 1, 2, 3), t=30.0, since=(0, 10, 20), latest=(0, 10, 20)
    )
    second = step(step.accept_sample(heard))
    assert [(s.sender, s.k, s.x[0]) for s in second.broadcasts[5].relays] == [
        (3, 20, 3.0),
        (2, 10, 2.0),
    ]


@pytest.mark.parametrize(
    ("name", "at"),
    [("newest", (1.0, 2.0)), ("carried-on", (1.0 + 3.0 + 0.035 * 0.5, 2.0 + 4.0 - 0.035 * 0.5))],
)
def test_a_belief_is_the_newest_state_or_that_carried_on(name: str, at: tuple[float, float]):
    knowledge = PeerKnowledge(swarm_of_scenario("radio", *belief(name)), 0)
    knowledge(np.full(32, np.nan), (0,), 0.0, {})
    x, known = knowledge(np.full(32, np.nan), (0,), 1.1, {1: statement(1, 1)})
    assert known == EVERYBODY
    assert x[4:6] == pytest.approx(at, abs=0.05)


def test_the_middle_of_a_set_is_where_a_peer_is_without_input():
    knowledge = PeerKnowledge(swarm_of_scenario("radio"), 0)
    x, _ = knowledge(np.full(32, np.nan), (0,), 0.0, {})
    assert np.array_equal(x[4:], swarm_of_scenario("radio").start()[4:]), "starts are known"
    x, _ = knowledge(np.full(32, np.nan), (0,), 5.0, {1: statement(1, 40)})
    assert x[4:8] == pytest.approx((4.0, 6.0, 3.0, 4.0))


def test_one_that_contradicts_itself_is_convicted_once_and_its_last_word_before_stays_believed():
    knowledge = PeerKnowledge(swarm_of_scenario("radio"), 0)
    for k, x, convictions in (
        (40, (1.0, 2.0, 3.0, 4.0), 0),
        (41, (1.3, 2.4, 3.0, 4.0), 0),
        (42, (9.6, 2.8, 3.0, 4.0), 1),
        (43, (1.9, 3.2, 3.0, 4.0), 0),
    ):
        knowledge(np.full(32, np.nan), (0,), 0.1 * k, {1: statement(1, k, x)})
        assert len(knowledge.convictions) == convictions
    assert knowledge.convicted == {1}
    assert knowledge.heard[1].t == pytest.approx(4.1)
    assert knowledge.heard[1].t_apply > 4.3, "so that it has no share of a gap"


def test_one_that_takes_over_in_the_middle_of_a_run_knows_no_peer_until_it_has_heard_it():
    knowledge = PeerKnowledge(swarm_of_scenario("radio"), 0)
    assert knowledge(np.full(32, np.nan), (0,), 3.0, {})[1] == (0,)
    assert knowledge(np.full(32, np.nan), (0,), 3.1, {4: statement(4, 1)})[1] == (0, 4)
    assert set(knowledge.heard) == {4}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("safety.composition=lse", "composition = 'pairs'"),
        ("safety.information=worst-case", "information = 'split'"),
        ("safety.prove=true", "prove = false"),
        ("safety.watch=true", "watch = false"),
        ("time.latency=0.01", "no time.latency"),
        ("agents.0.role=adversary", "adversaries"),
        ("agents.0.radio.rows=halves", "one believed state"),
    ],
)
def test_a_radio_that_does_not_fit_is_refused_with_what_would(change: str, words: str):
    with pytest.raises(ScenarioError, match=words):
        load("radio", [change])


def test_other_dynamics_and_functions_without_a_distance_are_refused():
    unicycle = 'agents.0.dynamics={type="triple-integrator", jerk=1.0, dimension=2}'
    with pytest.raises(ScenarioError):
        Simulation(rows_of_scenario("radio", unicycle))


FALSE_PLACE = {
    "kind": "lie",
    "agent": "2",
    "shift": [0.5, 0.0, 0.0, 0.0],
    "to": ["1"],
    "at": 0.4,
    "for": 1.0,
}


@pytest.mark.slow
def test_a_false_state_is_named_by_the_judge_and_the_same_when_judged_again(tmp_path):
    changes = {"duration": 1.2, "network.loss": 0, "agents.0.radio.relays": 0}
    honest, lied = (
        phalanx.run(
            phalanx.load("radio", {**changes, "faults": faults}), engine="in-process", out=tmp_path
        )
        for faults in ([], [FALSE_PLACE])
    )
    truthful = [a for a in lied.summary.theorem if a.name == "truthful broadcasts"]
    (of_honest,) = [a for a in honest.summary.theorem if a.name == "truthful broadcasts"]
    assert of_honest.failed == 0 < of_honest.checked
    assert truthful[0].failed == lied.summary.faults[-1].count > 0
    assert lied.summary.trajectory != honest.summary.trajectory
    again = lied.judge_again()
    assert (again.theorem, again.faults) == (lied.summary.theorem, lied.summary.faults)


@dataclass
class Looks:
    """A law that keeps the first and the last of what it was shown."""

    shown: ClassVar[list[View]] = []

    def prepare(self, dynamics):
        self.shown.clear()

    def input(self, view):
        self.shown.append(view)
        return np.zeros(2)


@pytest.mark.slow
def test_a_law_and_a_controller_see_the_age_of_a_peer_and_a_box_that_it_is_in():
    changes = {**TWO, "duration": 1.0, "network.loss": 0.0, "network.delay": 0.1}
    law = {"type": f"{__name__}:Looks"}
    for looking in {"agents.0.law": law}, {"agents.0.controller": law}:
        noisy = {"agents.0.disturbance": {"bound": 0.1, "kind": "adverse"}, **looking}
        run = phalanx.run(phalanx.load("radio", {**changes, **noisy}), engine="in-process")
        states = {round(t, 9): x for t, *x in run.states.select("t", "2.x", "2.y").rows()}
        views = [view for view in Looks.shown if view.i == 0 and view.t > 0.0]
        for view in views[5:]:
            assert 0.1 <= view.age[1] <= 0.1 + 0.35 + 0.05
            low, high = view.box[1]
            assert (low <= view.x[1]).all()
            assert (view.x[1] <= high).all()
            assert (low[:2] <= states[round(view.t, 9)]).all()
            assert (states[round(view.t, 9)] <= high[:2]).all()
    without = View(0, {}, (), None, None, t=0.0)
    assert (without.age, without.box) == ({}, {})


LIES = {
    "shift": {"shift": [1.0, 0.0, 0.0, 0.0]},
    "drift": {"drift": [0.0, 0.5, 0.0, 0.0]},
    "replay": {"replay": 20},
    "none": {"says": "zero"},
}


@pytest.mark.slow
@pytest.mark.parametrize("lie", LIES)
def test_a_peer_whose_states_contradict_each_other_is_convicted_and_none_that_only_announces_badly(
    lie,
):
    fault = {"kind": "lie", "agent": "2", "at": 0.5, "for": 9.0, **LIES[lie]}
    changes = {**TWO, "duration": 2.0, "network.loss": 0.0, "faults": [fault]}
    trust = phalanx.run(phalanx.load("radio", changes), engine="in-process").summary.trust
    assert trust.false == 0
    convicted = [(each.by, each.of) for each in trust.convictions]
    assert convicted == ([] if lie == "none" else [("1", "2")])
    assert trust.betrayals["2"] >= 0.5


NOISE = {"kind": "sensor", "at": 0.0, "for": 9.0, "noise": {"x": 0.01, "vx": 0.02}}
HONEST = {
    "pushed, in drag": {
        "agents.0.disturbance": {"bound": 0.2, "kind": "adverse"},
        "agents.0.dynamics.drag": 0.5,
    },
    "restarted, paused, late": {
        "agents.0.disturbance": {"bound": 0.1},
        "faults": [
            {"kind": "restart", "at": 0.5, "for": 0.3, "agents": ["2"]},
            {"kind": "pause", "at": 1.2, "for": 0.3, "agents": ["1"]},
            {"kind": "clock", "drift": 2.0, "at": 0.2, "for": 1.0, "agents": ["2"]},
        ],
    },
    "measured with errors": {
        "agents.0.radio": {"every": 3, "position_error": 0.05, "speed_error": 0.1},
        "faults": [NOISE],
    },
    "turned": {"faults": [{"kind": "turn", "at": 0.5, "agents": ["2"]}]},
    "delivered late, twice, in another order": {
        "network.delay": {"time": 0.3, "jitter": 0.3},
        "network.duplicate": 0.5,
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("case", HONEST)
def test_no_peer_that_states_what_is_true_is_convicted(case):
    changes = {**TWO, "duration": 2.0, "agents.0.radio.every": 3, **HONEST[case]}
    trust = phalanx.run(phalanx.load("radio", changes), engine="in-process").summary.trust
    assert trust.convictions == []


TWO = {
    "agents.0.count": 2,
    "agents.0.start": [[6.0, 0.2, 0.0, 0.0], [-6.0, 0.0, 0.0, 0.0]],
    "agents.0.goal": [[-6.0, 0.0], [6.0, 0.0]],
    "faults": [],
}


@pytest.mark.slow
def test_an_obstacle_in_the_way_is_never_reached_whatever_the_law_wants():
    obstacles = [
        {"center": [1.0, 0.3], "clearance": 1.0},
        {"center": [-1.5, -0.2], "size": [0.5, 1.0], "clearance": 0.5},
    ]
    scenario = phalanx.load("radio", {**TWO, "duration": 5.0, "obstacles": obstacles})
    run = phalanx.run(scenario, engine="in-process")
    assert run.verdict == phalanx.Outcome.GUARANTEED
    swarm = run.metrics.filter(agent="swarm")
    assert 0.0 < swarm["least_clearance"][0] < 0.05, "the law drives at them"


PRESSING = {
    "duration": 5.0,
    "network.loss": 0.5,
    "faults": [],
    "agents": [
        {
            "count": 2,
            "role": "normal",
            "law": {"type": "track-velocity", "gain": 1.0},
            "clock": {"period": 0.04, "jitter": 0.02},
            "disturbance": {"bound": 0.2, "kind": "adverse"},
            "radio": {"every": 5, "position_error": 0.01},
        }
    ],
}
KINDS = {
    "single-integrator": ({"speed": 1.5, "dimension": 3}, [[2.0, 0.1, 0.0], [-2.0, 0.0, 0.0]]),
    "unicycle": ({"speed": 2.0, "turn_rate": 4.0}, [[2.0, 0.1, 3.0], [-2.0, 0.0, 0.0]]),
    "differential-drive": (
        {"wheel_rate": 20.0, "wheel_radius": 0.1, "track": 0.4},
        [[2.0, 0.1, 3.0], [-2.0, 0.0, 0.0]],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_agents_whose_inputs_are_velocities_stop_before_one_another_at_any_heading(kind: str):
    fields, start = KINDS[kind]
    goal = [place[: fields.get("dimension", 2)] for place in start[::-1]]
    group = {"dynamics": {"type": kind, **fields}, "start": start, "goal": goal}
    agents = [{**PRESSING["agents"][0], **group}]
    run = phalanx.run(
        phalanx.load("crossing-radio", {**PRESSING, "agents": agents}), engine="in-process"
    )
    assert run.verdict != phalanx.Outcome.VIOLATED
    (least,) = run.metrics.filter(agent="swarm")["least_distance"]
    assert 1.0 < least < 1.3, "they press against one another"
    assert run.summary.origins["backup"] == 0


@pytest.mark.slow
def test_where_starts_are_not_known_an_agent_stands_until_it_has_heard_its_peers():
    blind = {**TWO, "duration": 1.0, "network.loss": 0.0, "network.delay": 0.3}
    speed = {}
    for knows in True, False:
        scenario = phalanx.load("radio", {**blind, "agents.0.radio.starts_known": knows})
        run = phalanx.run(scenario, engine="in-process")
        states = run.states
        speed[knows] = [states["1.vx"].abs().filter(states["t"] <= t).max() for t in (0.3, 1.0)]
        assert origins(run.recording) == run.summary.origins, "the report counts brakes too"
    assert speed[True][0] > 1.0
    assert speed[False][0] == 0.0 < speed[False][1]


def test_the_gain_is_one_for_all_the_least_that_a_group_has_or_by_the_rarest_broadcasts():
    swarm = swarm_of_scenario("radio")
    assert gain(swarm, EVERYBODY) == pytest.approx(1.2 / 0.35)
    table = swarm.scenario.model_dump(mode="json", exclude_none=True, by_alias=True)
    group = table["agents"][0]
    parts = [
        {**group, **{f: group[f][some] for f in ("names", "start", "goal")}, "radio": radio}
        for some, radio in ((slice(6), {"gain": 2.0}), (slice(6, 8), {"gain": 3.0, "every": 40}))
    ]
    of_two_groups = build_swarm(load({**table, "agents": parts}))
    assert {gain(of_two_groups, agents) for agents in (EVERYBODY, (7, *range(7)))} == {2.0}
