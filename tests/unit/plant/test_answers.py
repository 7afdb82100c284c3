"""Answers of agents: one to each sample, and none twice."""

import pytest
from msgspec.structs import replace
from phalanx_plant.hub.answers import Answers

from phalanx.faults.commands import ActiveCommands
from phalanx.messages.keys import Keys
from phalanx.messages.kinds import Actuation, Sample
from phalanx.messages.seal import Malformed, Sealer
from phalanx.network.inbox import AnnouncedInput, Conviction, DeliveryReport
from phalanx.swarm.attack import Attack
from phalanx.theory.rows.origin import Origin
from tests.unit.plant.runs import STEP, report
from tests.unit.swarms import rows_of_scenario, swarm_of_scenario

KEYS, SEALER = Keys("run"), Sealer(b"secret")


@pytest.fixture
def answers() -> Answers:
    """The answers of Simulation 1."""
    return Answers(swarm_of_scenario("unicycles"), KEYS, SEALER)


def sample(k: int) -> Sample:
    """Sample k of Simulation 1, all agents at their start."""
    x = swarm_of_scenario("unicycles").start().astype("<f8").tobytes()
    return Sample(k=k, t=0.01 * k, seen=tuple(range(5)), x=x, hearers=())


def test_an_actuation_that_was_taken_is_not_taken_again_for_the_next_sample(answers: Answers):
    answers.expect(0, sample(0))
    first = Actuation(k=0, t_apply=0.0, u=(1.0, 0.0))
    answers.on_actuation(0, first)
    assert answers.take_input(0).tolist() == [1.0, 0.0]
    with pytest.raises(Malformed, match="out of order"):
        answers.on_actuation(0, first)
    answers.expect(0, sample(1))
    assert answers.take_input(0) is None


GOOD = Actuation(k=1, t_apply=0.01, u=(1.0, 0.0))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"t_apply": 0.011}, "wrong time"),
        ({"u": (1e3, 0.0)}, "outside U"),
        ({"u": (1.0,)}, "wrong size"),
        ({"k": 0}, "out of order"),
        ({"k": 2}, "out of order"),
    ],
)
def test_an_actuation_that_is_not_the_answer_is_refused(
    answers: Answers, changes: dict[str, object], reason: str
):
    with pytest.raises(Malformed, match="out of order"):
        answers.on_actuation(0, GOOD)  # to no sample
    answers.expect(0, sample(1))
    with pytest.raises(Malformed, match=reason):
        answers.on_actuation(0, replace(GOOD, **changes))
    answers.on_actuation(0, GOOD)
    assert answers.take_input(0).tolist() == [1.0, 0.0]


def test_in_real_time_an_input_waits_for_the_report_on_its_own_sample(answers: Answers):
    answers.expect(0, sample(0))
    answers.on_telemetry(0, report(0))  # which nothing has taken yet
    answers.expect(0, sample(1))
    answers.on_actuation(0, GOOD)
    assert answers.take_reported(0) is None
    answers.on_telemetry(0, report(1))
    assert answers.take_reported(0).tolist() == [1.0, 0.0]


def test_a_report_may_come_after_the_next_sample_was_sent_but_not_twice(answers: Answers):
    answers.expect(0, sample(0))
    answers.expect(0, sample(1))
    answers.on_telemetry(0, report(0))
    assert answers.take_telemetry(0, 0) == report(0)
    with pytest.raises(Malformed, match="out of order"):
        answers.on_telemetry(0, report(0))


def test_an_agent_that_does_not_attack_by_itself_has_its_actuators_attack():
    rows = rows_of_scenario("unicycles")
    attack = Attack(rows, 0)
    answers = Answers(rows.swarm, KEYS, SEALER, {0: attack})
    commanded = replace(sample(1), commands=ActiveCommands(adversary=True, hidden=True))
    for i, first, second in ((0, sample(0), commanded), (1, sample(0), commanded)):
        answers.expect(i, first)
        answers.on_actuation(i, replace(GOOD, k=0, t_apply=0.0))
        assert answers.take_input(i).tolist() == list(GOOD.u)
        answers.expect(i, second)
        answers.on_telemetry(i, report(0))  # the report comes later than the next sample
        assert answers.take_telemetry(i, 0) == report(0)
        answers.on_actuation(i, GOOD)
        answers.expect(i, sample(2))
        answers.on_telemetry(i, report(1))
    decision, wish = attack(rows.swarm.start(), commanded.seen, commanded.t)
    assert answers.take_input(0).tolist() == decision.u.tolist() != list(GOOD.u)
    step = answers.take_telemetry(0, 1).report
    assert (step.origin, step.u_nom, step.residual) == (Origin.ATTACK, tuple(wish), 0.0)
    assert answers.take_input(1).tolist() == list(GOOD.u)
    assert answers.take_telemetry(1, 1) == report(1)


SAID = AnnouncedInput(0.0, (1.0, 0.0))


@pytest.mark.parametrize(
    "fate",
    [
        DeliveryReport(1, 2, 0.0, (), SAID),
        DeliveryReport(1, -1, 0.0, (), SAID),
        DeliveryReport(1, 0, 0.0),
        DeliveryReport(1, 0, -1.0, (), SAID),
        DeliveryReport(1, 0, 0.0, (), AnnouncedInput(0.0, (1.0,))),
    ],
    ids=["of the future", "of none", "said nothing", "lost and heard", "of another size"],
)
def test_a_report_on_a_broadcast_that_cannot_have_been_heard_so_is_refused(
    answers: Answers, fate: DeliveryReport
):
    for i in (0, 1):
        answers.expect(i, sample(0))
    with pytest.raises(Malformed, match="unknown broadcast"):
        answers.on_telemetry(0, report(0, fates=(fate,)))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"convictions": (Conviction(5, 0.0, 1.0, 0.1),)}, "unknown sender"),
        ({"convictions": (Conviction(-1, 0.0, 1.0, 0.1),)}, "unknown sender"),
        ({"report": replace(STEP, origin=Origin.PROVEN)}, "unknown origin"),
    ],
)
def test_a_report_of_agents_or_origins_that_there_are_not_is_refused(changes, reason, answers):
    answers.expect(0, sample(0))
    with pytest.raises(Malformed, match=reason):
        answers.on_telemetry(0, replace(report(0), **changes))


def test_sealed_and_pending_answers_are_accepted_from_each_agent(answers: Answers):
    answers.expect(0, sample(1))
    key, other_key = KEYS.actuation("1"), KEYS.actuation("2")
    with pytest.raises(Malformed, match="bad seal"):
        answers.accept(key, Sealer(b"another").seal(key, GOOD))
    with pytest.raises(Malformed, match="out of order"):
        answers.accept(other_key, SEALER.seal(other_key, GOOD))
    assert answers.accept(key, SEALER.seal(key, GOOD)) is None
    assert answers.take_input(0).tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("failed", "quoted"),
    [
        ("no\x1b[2Jvalue", r"'no\x1b[2Jvalue'"),
        ("a line\nagent 2 died: see its log", r"'a line\nagent 2 died: see its log'"),
        ("agent 1 is fine; agent 2 lies", "'agent 1 is fine; agent 2 lies'"),
        ("\u202eesrever", r"'\u202eesrever'"),
        ("x" * 2000, f"'{'x' * 500}' ..."),
    ],
    ids=["control", "lines", "another's name", "direction", "long"],
)
def test_an_agents_words_on_its_failure_are_quoted_as_its_own(answers: Answers, failed, quoted):
    key = KEYS.telemetry("1")
    answers.expect(0, sample(0))
    failure = answers.accept(key, SEALER.seal(key, report(0, failed=failed)))
    assert failure == ("1", f"agent 1 failed; it says: {quoted}")
