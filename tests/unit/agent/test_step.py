"""A control step without its controller: accepted messages, and joining a live run."""

import msgspec
import numpy as np
import pytest
from phalanx_agent.controller import DistributedController
from phalanx_agent.step import ControlStep

from phalanx.messages.kinds import LONGEST_FAILURE, MAX_BYTES, Broadcast, Sample, Telemetry
from phalanx.messages.seal import Malformed, Sealer
from phalanx.messages.step_report import QUANTITIES, StepReport
from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from tests.unit.swarms import rows_of_scenario
from tests.unit.tables import group, swarm_table

PERIOD = 0.01


@pytest.fixture
def step() -> ControlStep:
    """Agent 1's of Simulation 1."""
    return ControlStep(rows_of_scenario("unicycles"), 0)


def sample(step: ControlStep, k: int, latest: int) -> Sample:
    """The swarm where it starts, every other agent having sent broadcasts up to `latest`."""
    x = step.swarm.start().astype("<f8").tobytes()
    heard = step.swarm.heard_by(step.i)
    members = range(len(step.swarm.members))
    return Sample(
        k=k,
        t=PERIOD * k,
        seen=tuple(members),
        x=x,
        senders=heard if latest >= 0 else (),
        since=tuple(0 for _ in heard if latest >= 0),
        latest=tuple(latest for _ in heard if latest >= 0),
        hearers=heard,
    )


def hear(step: ControlStep, k: int) -> None:
    """Broadcast k of every agent that this one listens to arrives."""
    for j in step.swarm.heard_by(step.i):
        name = step.swarm.names[j]
        step.accept_broadcast(name, Broadcast(k=k, t_apply=PERIOD * k, u=(1.0, 0.0)))


@pytest.mark.parametrize("composition", ["lse", "pairs"])
@pytest.mark.parametrize(("u", "counts"), [((1.0, 0.0), True), ((0.0, 1e6), False)])
def test_an_input_that_no_actuator_of_its_sender_takes_does_not_count(composition, u, counts):
    """It would be credited with more than the best that the sender can do."""
    changes = f"safety.composition={composition}", "safety.information=paper"
    controller = DistributedController(rows_of_scenario("unicycles", *changes), 0)
    x, everybody = rows_of_scenario("unicycles", *changes).swarm.start(), tuple(range(5))
    result, alone = (
        controller(x, everybody, 0.01, received) for received in ({1: AnnouncedInput(0.01, u)}, {})
    )
    assert (1 in result.used) == counts
    assert counts or (result.decision.u == alone.decision.u).all()


@pytest.mark.parametrize("k", [0, 1, 37])
def test_a_successor_of_a_dead_agent_joins_at_any_sample(step: ControlStep, k: int):
    first = step.accept_sample(sample(step, k, latest=k - 1))
    assert not step.lacks_broadcasts(first), "it waits for what was sent before its time"
    answer = step(first)
    assert answer.actuation.k == answer.telemetry.k == k
    assert [broadcast.k for broadcast in answer.broadcasts.values()] == [k, k]
    assert answer.telemetry.ages == (), "it knows nobody's input yet"
    hear(step, k)
    second = step.accept_sample(sample(step, k + 1, latest=k))
    assert not step.lacks_broadcasts(second)
    ages = step(second).telemetry.ages
    assert [age for _, age in ages] == pytest.approx([PERIOD, PERIOD])


def test_a_broadcast_from_before_its_time_is_refused(step: ControlStep):
    step.accept_sample(sample(step, 5, latest=4))
    with pytest.raises(Malformed, match="out of order"):
        hear(step, 4)


def test_each_sender_may_send_as_much_as_its_own_clock_lets_it():
    groups = [
        group(name, "normal", [[5.0 * place, 0.0]], speed=1.0, period=period)
        for place, (name, period) in enumerate([("me", 0.01), ("quick", 0.01), ("slow", 0.1)])
    ]
    scenario = load(swarm_table(*groups, safety={"eta": 0.0}, duration=10.0))
    step = ControlStep(build_rows(build_swarm(scenario)), 0)
    late = Broadcast(k=2000, t_apply=0.0, u=(0.0, 0.0))
    step.accept_broadcast("quick", late)
    with pytest.raises(Malformed, match="from the future"):
        step.accept_broadcast("slow", late)


@pytest.mark.parametrize("k", [5, 4, 7, -1])
def test_after_the_first_every_sample_is_the_next(step: ControlStep, k: int):
    step.accept_sample(sample(step, 5, latest=4))
    with pytest.raises(Malformed, match="out of order"):
        step.accept_sample(sample(step, k, latest=4))


@pytest.mark.parametrize("k", [5, 4])
def test_in_real_time_samples_may_be_lost_but_none_comes_twice(step: ControlStep, k: int):
    def paced(k: int) -> Sample:
        return msgspec.structs.replace(sample(step, k, latest=4), pace=1.0)

    step.accept_sample(paced(2))
    step.accept_sample(paced(5))
    with pytest.raises(Malformed, match="out of order"):
        step.accept_sample(paced(k))


@pytest.mark.parametrize(
    "changes",
    [
        {"seen": (1, 2, 3, 4), "x": bytes(96)},
        {"senders": (0,), "since": (0,), "latest": (0,)},
        {"senders": (3,), "since": (0,), "latest": (0,)},
        {"hearers": (0, 1)},
        {"hearers": (1, 7)},
    ],
    ids=["not itself", "hears itself", "hears an adversary", "speaks to itself", "to nobody"],
)
def test_a_sample_about_others_than_it_can_be_about_is_refused(step: ControlStep, changes):
    spoilt = msgspec.structs.replace(sample(step, 0, latest=-1), **changes)
    with pytest.raises(Malformed, match="wrong agents"):
        step.accept_sample(spoilt)


def test_after_a_long_pause_it_tells_of_what_it_heard_in_reports_that_are_taken(step: ControlStep):
    """All that were sent meanwhile come in one sample, too many for one report."""
    step(step.accept_sample(sample(step, 0, latest=-1)))
    for k in range(1000):
        hear(step, k)
    reports = [
        step(step.accept_sample(sample(step, k, latest=999))).telemetry for k in (1, 2, 3, 4)
    ]
    reported = [(fate.sender, fate.k) for report in reports for fate in report.fates]
    assert sorted(reported) == [(j, k) for j in step.swarm.heard_by(0) for k in range(1000)]
    assert all(len(msgspec.msgpack.encode(report)) < MAX_BYTES for report in reports)
    assert len(reports[0].fates) > 800


@pytest.mark.parametrize("name", ["unicycles", "formation3d", "faults/restart"])
def test_a_report_with_all_that_it_may_say_is_taken(name: str):
    step = ControlStep(rows_of_scenario(name), 0)
    agents, faults = len(step.swarm.names), tuple(range(len(step.swarm.links.declared)))
    most, u = 2**32 - 1, (1e300,) * max(len(m.dynamics.inputs) for m in step.swarm.members)
    fates = (DeliveryReport(65535, most, 0.1, faults, AnnouncedInput(0.1, u)),) * step.most_fates
    step_report = StepReport(
        origin=Origin.SOLVER_FAILED, u_nom=u,
        **{name: 0.1 for name in QUANTITIES if name in StepReport.__struct_fields__},
    )  # fmt: skip
    report = Telemetry(
        k=most, report=step_report, ages=((65535, 0.1),) * agents, fates=fates, rejected=most,
        received=((65535, 0.1, u),) * agents, failed="?" * LONGEST_FAILURE,
    )  # fmt: skip
    assert MAX_BYTES / 2 < len(Sealer().seal("k", report)) <= MAX_BYTES


def test_it_decides_on_those_it_sees_alone():
    """Agents that are not in the sample change nothing, and no NaN gets into the result."""
    rows = rows_of_scenario("unicycles", "safety.neighbourhood=5.0")
    step, states = ControlStep(rows, 0), StateCodec(rows.swarm)
    visible, x = (0, 1, 2), rows.swarm.start()
    first = sample(step, 0, latest=-1)
    limited = msgspec.structs.replace(first, seen=visible, x=states.pack(x, visible))
    x[9:11] += 100.0  # agent 4, an adversary at 8 m, goes farther away
    elsewhere = msgspec.structs.replace(first, x=states.pack(x, tuple(range(5))))
    answers = [
        s(s.accept_sample(a)) for s, a in ((step, limited), (ControlStep(rows, 0), elsewhere))
    ]
    assert answers[0].actuation == answers[1].actuation
    assert answers[0].telemetry.report.origin is Origin.QP


def test_what_peers_hear_is_the_input_and_nothing_of_how_it_was_made(step: ControlStep):
    answer = step(step.accept_sample(sample(step, 0, latest=-1)))
    assert set(answer.broadcasts) == set(step.swarm.heard_by(step.i))
    for broadcast in answer.broadcasts.values():
        assert broadcast == Broadcast(k=0, t_apply=0.0, u=answer.actuation.u)


@pytest.mark.parametrize(
    ("number", "reason"), [(np.nan, "not finite"), (np.inf, "not finite"), (-9e305, "too large")]
)
def test_a_state_that_no_world_has_is_refused(step: ControlStep, number: float, reason: str):
    x = step.swarm.start()
    x[4] = number
    spoilt = msgspec.structs.replace(sample(step, 0, latest=-1), x=x.astype("<f8").tobytes())
    with pytest.raises(Malformed, match=reason):
        step.accept_sample(spoilt)


def test_its_own_broadcast_is_refused(step: ControlStep):
    with pytest.raises(Malformed, match="unknown sender"):
        step.accept_broadcast(step.name, Broadcast(k=0, t_apply=0.0, u=(1.0, 0.0)))
