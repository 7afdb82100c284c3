"""Who judges: pair truth, actuators, and the theorem's assumptions."""

import msgspec
import numpy as np
import pytest

from phalanx.guarantee.verdict import Assumption
from phalanx.plant.actuators import Actuators
from phalanx.plant.judge import Judge
from phalanx.plant.truth import PairExtremes
from phalanx.plant.world import DisturbanceKnot, IntegrationSteps
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import VERSION, Input, Sample

SWARM = build_swarm(load("unicycles"))
PAIRS = len(SWARM.chain.set.pairs)
LABELS = [SWARM.chain.set.label(pair) for pair in SWARM.chain.set.pairs]


def seen(truth: PairExtremes, times: list[float], **h: list[float]) -> None:
    """Show a truth: the pairs' h by label ("1-2" as p1_2), all others -50."""
    table = np.full((len(times), PAIRS), -50.0)
    for name, values in h.items():
        table[:, LABELS.index(name[1:].replace("_", "-"))] = values
    truth.add(np.array(times), table, table.max(axis=1) + 0.01)


def test_a_violation_has_its_pair_its_beginning_its_depth_and_its_length():
    truth = PairExtremes(SWARM.chain.set)
    seen(truth, [0.1, 0.2, 0.3], p1_2=[-1.0, -0.5, 0.5])
    seen(truth, [0.4, 0.6], p1_2=[2.0, -0.1], p3_5=[-3.0, 0.25])
    seen(truth, [0.7, 0.8], p1_2=[-0.2, 0.1], p3_5=[0.5, -1.0])
    deeper, shallower = truth.violations()
    assert (deeper.pair, shallower.pair) == ("1-2", "3-5")
    assert (deeper.first, deeper.worst, deeper.worst_at) == (0.3, 2.0, 0.4)
    assert deeper.duration == pytest.approx(0.1 + 0.1 + 0.1)
    assert (shallower.first, shallower.worst, shallower.worst_at) == (0.6, 0.5, 0.7)
    assert shallower.duration == pytest.approx(0.2 + 0.1)
    assert truth.worst_pair == "1-2"
    assert truth.worst_h_tot == pytest.approx(2.01)
    assert truth.worst_at == 0.4


def test_h_at_exactly_zero_is_safe():
    truth = PairExtremes(SWARM.chain.set)
    seen(truth, [0.1, 0.2], p1_2=[0.0, -0.1])
    assert truth.violations() == []


def test_lse_above_zero_is_no_departure_while_every_pair_is_at_most_zero():
    truth = PairExtremes(SWARM.chain.set)
    departures = []
    for t, h in ((0.1, -0.005), (0.2, 0.1), (0.3, -1.0)):
        seen(truth, [t], p1_2=[h])
        departures.append(truth.unsafe)
    assert truth.worst_h_tot > 0.0
    assert departures == [False, True, False]


def test_an_h_that_is_not_a_number_is_not_safe():
    """NaN > 0 is false, but so is NaN <= 0, and safe is h <= 0."""
    truth = PairExtremes(SWARM.chain.set)
    seen(truth, [0.1, 0.2], p1_2=[-1.0, float("nan")])
    assert [v.pair for v in truth.violations()] == ["1-2"]


def test_the_peak_is_that_since_it_was_last_taken_the_value_then_included():
    truth = PairExtremes(SWARM.chain.set)
    seen(truth, [0.1, 0.2], p1_2=[-1.0, -2.0])
    assert truth.take_peak() == pytest.approx(-0.99)
    seen(truth, [0.3, 0.4], p1_2=[-3.0, -2.5])
    assert truth.take_peak() == pytest.approx(-1.99)
    seen(truth, [0.5, 0.6], p1_2=[-3.0, -4.0])
    assert truth.take_peak() == pytest.approx(-2.49)
    assert truth.worst_h_tot == pytest.approx(-0.99)


def message(k: int = 0, t: float = 0.0, u=(0.0, 0.0), ages=(), origin=Origin.QP) -> Input:
    return Input(VERSION, k, t, t, t + 0.01, u, origin, 0.0, 0.0, ages)


def sample(x: np.ndarray) -> Sample:
    return Sample(VERSION, 0, 0.0, x.astype("<f8").tobytes(), (-1,) * 5)


@pytest.mark.parametrize(
    ("i", "u", "admitted"),
    [
        (0, (4.0, 2.0), True),
        (0, (-4.0, -2.0), True),
        (0, (4.001, 0.0), False),
        (0, (0.0, -2.001), False),
        (3, (2.0, 1.0), True),
        (3, (4.0, 0.0), False),
        (3, (0.0, 1.5), False),
        (0, (float("nan"), 0.0), False),
    ],
)
def test_an_actuator_takes_no_input_outside_its_polytope(i, u, admitted):
    actuators = Actuators(SWARM)
    assert actuators.admissible(i, sample(np.zeros(15)), message(u=u)) == admitted


SHRINKING = '''
from dataclasses import dataclass
import casadi as ca

@dataclass(frozen=True)
class Shrinking:
    """A point whose speed bounds shrink away from the origin."""
    inputs: tuple[str, ...] = ("vx", "vy")
    states = ("x", "y")
    def drift(self, x): return ca.SX.zeros(2)
    def actuation(self, x): return ca.SX.eye(2)[:, :len(self.inputs)]
    def position(self, x): return x
    def input_polytope(self, x):
        m = len(self.inputs)
        b = 1 / (1 + x[0] ** 2) * ca.SX.ones(2 * m)
        return ca.vertcat(ca.SX.eye(m), -ca.SX.eye(m)), b
    def input_metric(self): return (1.0,) * len(self.inputs)

@dataclass
class Rest:
    """Wants to stay."""
    def prepare(self, dynamics): ...
    def input(self, view): ...
'''


@pytest.mark.parametrize("inputs", [["vx", "vy"], ["vx"]], ids=["two inputs", "one input"])
def test_an_actuator_whose_polytope_varies_is_held_to_the_one_at_the_sampled_state(
    inputs, tmp_path, monkeypatch
):
    (tmp_path / "shrinking_user.py").write_text(SHRINKING)
    monkeypatch.syspath_prepend(tmp_path)
    overrides = [
        f"agents.0.dynamics={{ type = 'shrinking_user:Shrinking', inputs = {inputs} }}",
        "agents.0.law={ type = 'shrinking_user:Rest' }",
        "agents.0.spread=[]",
    ]
    actuators = Actuators(build_swarm(load("unicycles", overrides)))
    x, rest = np.zeros(12), (0.0,) * (len(inputs) - 1)
    assert actuators.admissible(0, sample(x), message(u=(1.0, *rest)))
    x[0] = 3.0
    assert not actuators.admissible(0, sample(x), message(u=(1.0, *rest)))
    assert actuators.admissible(0, sample(x), message(u=(0.1, *rest)))
    x[0], x[2] = 0.0, 3.0
    assert actuators.admissible(0, sample(x), message(u=(1.0, *rest)))


def assumption(judge: Judge, name: str) -> Assumption:
    return next(a for a in judge.assumptions if a.name == name)


def counted(judge: Judge, name: str) -> tuple[int, int, float | None]:
    found = assumption(judge, name)
    return found.failed, found.checked, found.first


def test_a_sampling_gap_above_the_period_and_its_jitter_is_counted():
    judge = Judge(SWARM)
    for t in (0.0, 0.012, 0.020, 0.0325, 0.0425, 0.060):
        judge.sampled(1, t)
    assert counted(judge, "sampling gap") == (2, 5, 0.0325)
    judge.sampled(2, 0.5)
    assert counted(judge, "sampling gap")[1] == 5


def test_a_received_input_is_fresh_only_while_it_is_what_its_sender_applies():
    judge = Judge(SWARM)
    judge.applied(1, message(k=0, t=0.00))
    judge.applied(0, message(k=0, t=0.005, ages=(None, 0.005, None, None, None)))
    assert counted(judge, "fresh û") == (0, 1, None)
    judge.applied(1, message(k=1, t=0.01))
    judge.applied(0, message(k=1, t=0.015, ages=(None, 0.015, None, None, None)))
    assert counted(judge, "fresh û") == (1, 2, 0.015)
    judge.applied(0, message(k=2, t=0.025, ages=(None, 0.015, None, None, None)))
    assert counted(judge, "fresh û") == (1, 3, 0.015)


def test_normal_agents_sample_together_if_each_takes_its_kth_sample_at_the_same_instant():
    judge = Judge(build_swarm(load("unicycles", ["safety.control=centralised"])))
    for k, times in enumerate([(0.0, 0.0, 0.0), (0.01, 0.01, 0.012), (0.02, 0.02, 0.02)]):
        for i, t in enumerate(times):
            judge.applied(i, message(k=k, t=t))
    assert counted(judge, "synchronous sampling") == (1, 9, 0.012)


def test_freshness_is_no_assumption_of_a_row_that_needs_nothing_from_others():
    split: Swarm = build_swarm(load("unicycles", ["safety.information=split"]))
    assert "fresh û" not in [a.name for a in Judge(split).assumptions]
    assert "fresh û" in [a.name for a in Judge(SWARM).assumptions]


def test_steps_are_counted_by_origin_and_without_authority_there_is_no_backup():
    judge = Judge(SWARM)
    origins = [Origin.QP, Origin.BACKUP, Origin.NO_AUTHORITY, Origin.QP]
    for k, origin in enumerate(origins):
        judge.applied(0, message(k=k, t=k / 100, origin=origin))
    judge.applied(4, message(origin=Origin.ATTACK))
    assert judge.steps == 5
    assert judge.origins == {"qp": 2, "backup": 1, "no-authority": 1}
    assert judge.backups == 1
    assert counted(judge, "non-empty K_i") == (2, 4, 0.01)


def test_a_disturbance_beyond_its_bound_is_counted_at_its_knot():
    judge, x = Judge(SWARM), np.zeros(15)
    phi = np.zeros(15)
    phi[3:6] = 1.73 / np.sqrt(3)
    judge.at_event(0.1, x, [DisturbanceKnot(0.1, phi)])
    assert counted(judge, "disturbance bound") == (0, 1, None)
    judge.at_event(0.2, x, [DisturbanceKnot(0.2, 1.01 * phi)])
    assert counted(judge, "disturbance bound") == (1, 2, 0.2)


@pytest.mark.parametrize(("h", "failed"), [(-1.0, 0), (0.0, 0), (0.1, 1)])
def test_a_start_outside_the_safe_set_is_counted_once(h, failed):
    judge = Judge(SWARM)
    for t in (0.0, 0.001):
        truth = IntegrationSteps(np.array([t]), np.full((1, PAIRS), h), np.full(1, h))
        judge.at_event(t, np.zeros(15), [truth])
    assert counted(judge, "start in S")[:2] == (failed, 1)


def test_a_given_margin_is_never_called_proven():
    assert assumption(Judge(SWARM), "proven margin").failed == 1


def test_the_trajectory_hash_knows_every_state_and_every_input():
    def run(x: float = 1.0, u: float = 0.5, i: int = 0, t: float = 0.1, solve: float = 0.0) -> str:
        judge = Judge(SWARM)
        judge.at_event(t, np.full(15, x), [])
        judge.applied(i, msgspec.structs.replace(message(u=(u, 0.0)), solve_time=solve))
        return judge.trajectory

    up = np.nextafter
    variants = [run(), run(x=up(1.0, 2)), run(u=up(0.5, 1)), run(i=1), run(t=up(0.1, 1))]
    assert len(set(variants)) == 5
    assert run() == run(solve=0.7), "wall time is no part of the trajectory"
