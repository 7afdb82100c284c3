"""What agents may answer: each sample once, and nothing twice."""

import pytest

from phalanx.plant.answers import Answers
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Actuation, Sample, Telemetry
from phalanx.wire.seal import Malformed
from tests.unit.swarms import swarm_of_scenario


def sample(k: int) -> Sample:
    """Sample k of Simulation 1, everybody where they start."""
    x = swarm_of_scenario("unicycles").start().astype("<f8").tobytes()
    nothing = (-1,) * 5
    return Sample(
        k=k, t=0.01 * k, seen=tuple(range(5)), x=x, since=nothing, latest=nothing, hearers=()
    )


def test_an_actuation_that_was_taken_is_not_taken_again_for_the_next_sample():
    answers = Answers(swarm_of_scenario("unicycles"))
    answers.expect(0, sample(0))
    first = Actuation(k=0, t_apply=0.0, u=(1.0, 0.0))
    answers.on_actuation(0, first)
    assert answers.take_actuation(0) == first
    with pytest.raises(Malformed, match="out of order"):
        answers.on_actuation(0, first)
    answers.expect(0, sample(1))
    assert answers.take_actuation(0) is None


def test_a_report_may_come_after_the_next_sample_was_sent_but_not_twice():
    answers = Answers(swarm_of_scenario("unicycles"))
    answers.expect(0, sample(0))
    answers.expect(0, sample(1))
    report = Telemetry(
        k=0, origin=Origin.QP, residual=0.0, u_nom=(0.0, 0.0), solve_time=0.0, ages=()
    )
    answers.on_telemetry(0, report)
    assert answers.take_telemetry(0, 0) == report
    with pytest.raises(Malformed, match="out of order"):
        answers.on_telemetry(0, report)
