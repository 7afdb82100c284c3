"""The judge: counts of each assumption's checks and failures."""

import casadi as ca
import numpy as np
import pytest
from msgspec.structs import replace
from phalanx_plant.judge.claims import Claims
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.judge.event_columns import EventColumns
from phalanx_plant.judge.judge import Judge, Judged
from phalanx_plant.world.evaluation import EvaluatedSteps
from phalanx_plant.world.events import (
    CommandApplied,
    Event,
    InputApplied,
    InputLost,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.world.world import DisturbanceKnot, DivergedError, Segment

from phalanx.faults.commands import Command, CommandKind
from phalanx.guarantee.verdict import Assumption
from phalanx.network.inbox import AnnouncedInput, Conviction, DeliveryReport
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.models.world import WorldNote
from phalanx.theory.rows.origin import Origin
from tests.unit.plant.runs import STEP, report
from tests.unit.swarms import rows_of_scenario


def judge_of(*overrides: str) -> Judge:
    """Return a judge at the start of Simulation 1."""
    return Judge(rows_of_scenario("unicycles", *overrides))


def happen(judge: Judge, *events: Event) -> list[Judged]:
    """Judge these events."""
    judge.judge(events, judged := list[Judged]())
    return judged


def applied(
    i: int,
    k: int = 0,
    t: float = 0.0,
    ages=(),
    origin: Origin = Origin.QP,
    t_apply: float | None = None,
    u: tuple[float, float] = (0.0, 0.0),
    **fields,
) -> InputApplied:
    """Agent i's input for a sample at t [s] takes effect, at once or at t_apply [s].

    fields: more of its report on it.
    """
    t_apply = t if t_apply is None else t_apply
    telemetry = report(k, replace(STEP, origin=origin), ages=ages, **fields)
    return InputApplied(i, k, t, t_apply, np.array(u), telemetry=telemetry)


def apply(judge: Judge, *agent: int, **fields) -> Judged:
    (judged,) = happen(judge, applied(*agent, **fields))
    return judged


def texts(*judged: Judged) -> list[str]:
    return [line.text for each in judged for line in each.notices]


def command(judge: Judge, kind: CommandKind, i: int, t: float = 0.0) -> None:
    """Let a command on agent i take effect."""
    name = rows_of_scenario("unicycles").swarm.names[i]
    happen(judge, CommandApplied(Command(t, kind, name), i))


def assumption(judge: Judge, name: str) -> Assumption:
    return next(
        a
        for a in [*judge.assumptions.of_guarantee, *judge.assumptions.of_theorem]
        if a.name == name
    )


def counted(judge: Judge, name: str) -> tuple[int, int, float | None]:
    found = assumption(judge, name)
    return found.failed, found.checked, found.first


@pytest.mark.slow
def test_a_sampling_gap_above_the_period_and_its_jitter_is_counted():
    judge = judge_of("agents.1.clock.period=0.05")  # of the adversaries
    for t in (0.0, 0.012, 0.020, 0.0325, 0.0425, 0.060):
        happen(judge, Sampled(1, t))
    assert counted(judge, "sampling gap") == (2, 5, 0.0325)
    happen(judge, Sampled(2, 0.0))
    assert counted(judge, "sampling gap")[1] == 5
    happen(judge, Sampled(0, 0.05))
    assert counted(judge, "sampling gap")[:2] == (3, 6), "the first sample was to come at t = 0"
    happen(judge, Sampled(3, 0.05))
    assert counted(judge, "sampling gap")[1] == 6, "when an adversary samples matters to none"
    command(judge, CommandKind.TURN, 2, 0.01)
    happen(judge, Sampled(2, 0.05))
    assert counted(judge, "sampling gap")[1] == 6, "nor when one does that turned"


@pytest.mark.slow
def test_a_sampling_gap_that_lasts_to_the_end_of_the_run_is_counted():
    """Agent 2's last sample is too old then, and one of agent 3 never came."""
    judge = judge_of("duration=0.5")
    for t in (0.0, 0.01):
        happen(judge, Sampled(1, t))
    happen(judge, Sampled(0, 0.0))
    happen(judge, *[Sampled(0, 0.01 * k) for k in range(1, 50)])
    assert counted(judge, "sampling gap") == (0, 50, None)
    happen(judge, StateReached(0.5, rows_of_scenario("unicycles").swarm.start(), []))
    assert counted(judge, "sampling gap") == (2, 53, 0.5)


@pytest.mark.slow
def test_a_received_input_is_fresh_only_while_it_is_what_its_sender_applies():
    judge = judge_of()
    apply(judge, 1, k=0, t=0.00)
    apply(judge, 0, k=0, t=0.005, ages=((1, 0.005),))
    assert counted(judge, "received inputs in force") == (0, 1, None)
    apply(judge, 1, k=1, t=0.01)
    apply(judge, 0, k=1, t=0.015, ages=((1, 0.015),))
    assert counted(judge, "received inputs in force") == (1, 2, 0.015)
    apply(judge, 0, k=2, t=0.025, ages=((1, 0.015),))
    assert counted(judge, "received inputs in force") == (1, 3, 0.015)
    happen(judge, applied(1, k=2, t=0.03), applied(0, k=3, t=0.035, ages=((1, 0.005),)))
    assert counted(judge, "received inputs in force") == (1, 4, 0.015)


def test_a_received_input_that_a_lie_claimed_is_not_in_force_though_its_time_is():
    """Agent 2 tells agent 3 the truth, and agent 1 another input than it holds."""
    judge = judge_of()
    judged = [apply(judge, 1, t=0.0, u=(1.0, 0.0))]
    for i, speed in ((2, 1.0), (0, -1.0), (0, -1.0)):
        fates = (DeliveryReport(1, 0, 0.0, (), AnnouncedInput(0.0, (speed, 0.0))),)
        judged.append(apply(judge, i, t=0.005, ages=((1, 0.005), (3, 0.001)), fates=fates))
    assert [texts(each) for each in judged] == [[], [], ["agent 2: first false broadcast"], []]
    assert [each.step["oldest_input"] for each in judged] == [None, 0.005, 0.005, 0.005]
    assert counted(judge, "received inputs in force") == (5, 6, 0.005)
    assert counted(judge, "truthful broadcasts") == (2, 3, 0.005)


def test_a_lie_of_an_input_that_came_late_is_not_in_force_though_it_states_that_time():
    judge = judge_of()
    apply(judge, 1, t=0.0, t_apply=0.002, u=(1.0, 0.0))
    fates = (DeliveryReport(1, 0, 0.0, (), AnnouncedInput(0.002, (-1.0, 0.0))),)
    apply(judge, 0, t=0.005, ages=((1, 0.003),), fates=fates)
    assert counted(judge, "received inputs in force") == (1, 1, 0.005)


def test_a_failure_counts_for_its_fault_and_what_was_dropped_before_a_restart_counts_too():
    judge = judge_of()
    apply(judge, 0, rejected=2)
    apply(judge, 1, rejected=16)
    for k, rejected in ((1, 1), (2, 3)):  # two restarts; a process counts from 0
        kill, restart = (
            CommandApplied(Command(t, kind, "1", fault=4), 0, forgotten)
            for t, kind, forgotten in (
                (0.2 * k - 0.1, CommandKind.KILL, (1, 3)), (0.2 * k, CommandKind.RESTART, ()),
            )
        )  # fmt: skip
        assert texts(*happen(judge, kill, restart)) == [
            "agent 1 killed; lost with it: the inputs received of 2, 4",
            "agent 1 restarted, with nothing received",
        ]
        apply(judge, 0, k=k, t=0.2 * k, rejected=rejected)
    assert judge.claims.faults == {4: 2}
    assert judge.findings().rejected == {"by agent 1": 6, "by agent 2": 16}


def test_an_agent_that_is_out_of_reach_is_silent_until_it_is_back():
    judge = judge_of()
    judged = happen(judge, MemberLost(0, 0.1, back=False), MemberLost(0, 0.2, back=True))
    lost, back = "agent 1 is lost; its actuator holds its input", "agent 1 is back"
    assert texts(*judged) == [lost, back]
    assert counted(judge, "faithful agents") == (1, 1, 0.1)
    (judged,) = happen(judge, MemberLost(1, 0.3, back=False, why="it says: hung"))
    assert texts(judged) == ["agent 2 is lost (it says: hung); its actuator holds its input"]
    assert judge.findings().lost == [
        "agent 1 at t = 0.100 s",
        "agent 2 at t = 0.300 s (it says: hung)",
    ]


CONVICTED = {"convictions": (Conviction(1, 0.0, 0.01, 2.0),)}


@pytest.mark.slow
def test_a_conviction_counts_if_a_normal_agent_reports_it():
    """Agent 4 is an adversary, and agent 3 turns; both say of agent 2 what agent 1 says."""
    judge = judge_of("safety.watch=true")
    command(judge, CommandKind.TURN, 2)
    for i in (0, 2, 3):
        apply(judge, i, t=0.01, **CONVICTED)
    trust = judge.findings().trust
    assert [(each.by, each.of) for each in trust.convictions] == [("1", "2")]
    assert trust.rows[1:] == [
        ("convictions", "1 by 1 agent"),
        ("first convicted", "none"),
        ("false convictions", "1"),
    ]


@pytest.mark.slow
def test_normal_agents_sample_together_if_each_takes_its_kth_sample_at_the_same_instant():
    judge = judge_of("safety.control=centralised")
    for k, times in enumerate([(0.0, 0.0, 0.0), (0.01, 0.01, 0.012), (0.02, 0.02, 0.02)]):
        for i, t in enumerate(times):
            apply(judge, i, k=k, t=t)
    assert counted(judge, "synchronous sampling") == (1, 9, 0.012)


@pytest.mark.slow
def test_freshness_is_no_assumption_of_a_row_that_needs_nothing_from_others():
    alone = judge_of("safety.information=worst-case")
    assert "received inputs in force" not in [a.name for a in alone.assumptions.of_theorem]
    assert "received inputs in force" in [a.name for a in judge_of().assumptions.of_theorem]


@pytest.mark.slow
def test_steps_are_counted_by_origin_and_without_authority_there_is_no_backup():
    judge = judge_of()
    origins = [Origin.QP, Origin.BACKUP, Origin.NO_AUTHORITY, Origin.BACKUP]
    judged = [apply(judge, 0, k=k, t=k / 100, origin=of) for k, of in enumerate(origins)]
    assert [texts(each) for each in judged] == [[], ["agent 1: first backup"], [], []]
    apply(judge, 4, origin=Origin.ATTACK)
    findings = judge.findings()
    assert findings.steps == 5
    assert findings.origins == {"qp": 1, "solver-failed": 0, "backup": 2, "no-authority": 1}
    assert counted(judge, "non-empty K_i") == (3, 4, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("origin", "failed"), [(Origin.LONGEST, 1), (Origin.BACKUP, 1), (Origin.SOLVER_FAILED, 0)]
)
def test_an_agent_whose_input_keeps_none_of_its_rows_had_an_empty_k_i(origin, failed):
    """One that takes the longest certified input, too; a solver that failed is no empty K_i."""
    proving = ("safety.composition=pairs", "safety.information=split", "safety.prove=true")
    judge = judge_of(*proving)
    apply(judge, 0, origin=origin)
    assert counted(judge, "non-empty K_i")[:2] == (failed, 1)
    assert judge.findings().origins[str(origin)] == 1


@pytest.mark.slow
def test_a_disturbance_beyond_its_bound_and_what_a_world_says_are_counted():
    judge = judge_of()
    phi = np.zeros(15)
    phi[3:6] = 1.73 / np.sqrt(3)
    judge.assumptions.add_piece(DisturbanceKnot(0.1, phi))
    assert counted(judge, "disturbance bound") == (0, 1, None)
    assert "above" not in assumption(judge, "disturbance bound").note
    judge.assumptions.add_piece(DisturbanceKnot(0.2, 2.0 * phi))
    judge.assumptions.add_piece(DisturbanceKnot(0.3, (1.0 + 1e-6) * np.roll(phi, 3)))
    assert counted(judge, "disturbance bound") == (2, 3, 0.2)
    most = "the most above was 3.46, of agent 2, at t = 0.200 s"
    assert assumption(judge, "disturbance bound").note.endswith(f"disturbance.bound; {most}")
    judge.assumptions.add_piece(WorldNote(0.4, "it is late", "odometry"))
    assert counted(judge, "odometry") == (1, 1, 0.4)


def steps(times: list[float], h: list[float], psi: list[float] | None = None) -> EvaluatedSteps:
    """Return steps with values of the first two pairs, without the others."""
    both = np.array([h, h]).T
    return EvaluatedSteps(
        np.zeros(len(times), dtype=np.intp),
        np.array(times),
        np.arange(2),
        both,
        both.max(axis=1),
        np.array(psi or []),
        np.ones(len(times), dtype=bool),
    )


def hold(coverage: Coverage, i: int = 0, t: float = 0.0, seconds: float = 0.0, until=()) -> None:
    """Certify agent i's pairs for so many seconds from t [s] on, or go on to other times."""
    telemetry, swarm = report(0, STEP), rows_of_scenario("unicycles").swarm
    events: list[Event] = [StateReached(at, swarm.start(), []) for at in until]
    events += [] if until else [InputApplied(i, 0, t, t, np.zeros(2), telemetry=telemetry)]
    columns, none = EventColumns(swarm, Claims(swarm)).of(events), np.zeros((0, 15))
    issued = coverage.proven(columns.inputs, none if until else swarm.start()[None])
    issued = issued._replace(seconds=np.full(len(issued.sides), seconds))
    coverage.add(columns.states, columns.inputs, issued)


@pytest.mark.slow
def test_a_pair_is_covered_as_long_as_either_of_its_agents_holds_a_certificate():
    coverage = judge_of().coverage
    pairs = rows_of_scenario("unicycles").swarm.safe_set.pairs
    (both,) = (k for k, pair in enumerate(pairs) if (pair.a, pair.b) == (0, 1))
    for i, t, seconds, ends in ((0, 1.0, 0.5, 1.5), (1, 1.1, 0.0, 1.5), (0, 1.2, 0.0, -np.inf)):
        hold(coverage, i, t, seconds)
        assert coverage.ends[both] == ends


def test_until_its_first_input_a_start_is_certified_no_longer_than_it_takes_to_meet():
    """Agent 1 stands still; agent 2 is 1/64 m off, at 1 m/s."""
    rows = rows_of_scenario("one-on-one", f"agents.1.start=[[0.0, {-1.0 - 1.0 / 64.0}]]")
    (end,) = Judge(rows).coverage.ends
    assert 0.9 / 64.0 < end < 1.0 / 64.0


@pytest.mark.slow
@pytest.mark.parametrize("turns", [True, False])
def test_a_pair_without_a_normal_agent_needs_no_certificate_any_more(turns):
    judge = judge_of()
    for i in (0, 1, 2):
        hold(judge.coverage, i, 0.0, 1.0)
    if turns:
        command(judge, CommandKind.TURN, 0)
    for i in (1, 2):
        hold(judge.coverage, i, 0.9, 2.0)
    for t, uncovered in ((1.0, 0), (2.0, int(not turns))):
        hold(judge.coverage, until=[t])
        assert counted(judge, "certificates")[0] == uncovered


@pytest.mark.slow
@pytest.mark.parametrize(("h", "failed"), [(-1.0, 0), (0.0, 0), (0.1, 1)])
def test_a_start_outside_the_safe_set_is_counted_once(h, failed):
    judge = judge_of()
    for t in (0.0, 0.001):
        judge.assumptions.moved(steps([t], [h]))
    assert counted(judge, "start in S")[:2] == (failed, 1)


@pytest.mark.slow
@pytest.mark.parametrize("unsafe", [0, 1])
def test_one_pair_makes_a_start_unsafe_though_it_gets_away_before_the_first_event(unsafe):
    judge, h = judge_of(), np.full((2, 2), -1.0)
    h[0, unsafe] = 0.1
    judge.assumptions.moved(steps([0.0, 0.001], [-1.0, -1.0])._replace(h=h))
    assert counted(judge, "start in S") == (1, 1, 0.0)


@pytest.mark.slow
def test_one_step_without_an_h_tot_is_the_end():
    both = steps([0.0, 0.001], [-1.0, -1.0]), steps([0.002, 0.003, 0.004], [-1.0, np.nan, -1.0])
    both[1].h[:, 0] = -1.0
    numbered = both[1]._replace(numbers=np.array([4, 5, 5]))
    assert judge_of().diverged(both[:1]) is None
    number, error = judge_of().diverged([both[0], numbered]) or (0, None)
    assert (number, str(error).partition(":")[0]) == (
        5,
        "h of 1-3 is no longer finite at t = 0.004 s",
    )


@pytest.mark.slow
def test_what_happened_before_h_tot_is_no_number_is_judged_and_nothing_after_it():
    judge, x = judge_of(), start_with(heading=0.0)
    nothing, p = np.zeros(15), np.zeros((1, 5, 2))
    begun = Segment(0.0, 0.01, 0.01, nothing, nothing, np.zeros(10), x, x[None], p)
    ends = Segment(0.01, 0.01, 0.02, nothing, nothing, np.zeros(10), x, np.nan * x[None], p)
    events = [StateReached(t, x, [way]) for t, way in ((0.01, begun), (0.02, ends), (0.03, begun))]
    judged = list[Judged]()
    with pytest.raises(DivergedError):
        judge.judge(events, judged)
    assert [each.event for each in judged] == events[:1]


@pytest.mark.slow
def test_an_input_without_its_report_is_not_judged():
    with pytest.raises(ValueError, match="inputs with their reports"):
        happen(judge_of(), InputApplied(0, 0, 0.0, 0.0, np.zeros(2)))


@pytest.mark.slow
def test_an_input_that_is_lost_did_not_come_in_time():
    judge = judge_of()
    assert "inputs in time" not in [a.name for a in judge.assumptions.of_guarantee]
    happen(judge, InputLost(0, 3, 0.03, 0.032, np.zeros(2), report(3)))
    assert counted(judge, "inputs in time") == (1, 1, 0.032)
    fates = (DeliveryReport(0, 3, 0.0, (), AnnouncedInput(0.03, (0.0, 0.0))),)
    apply(judge, 1, t=0.04, fates=fates)
    assert counted(judge, "truthful broadcasts") == (1, 1, 0.04), "it was never held"
    for rests_on in (judge.assumptions.of_guarantee, judge.assumptions.of_theorem):
        assert "inputs in time" in [a.name for a in rests_on]


@pytest.mark.slow
def test_what_a_guarantee_rests_on():
    named = [a.name for a in judge_of().assumptions.of_guarantee]
    expected = ["start in S", "sampling gap", "disturbance bound", "admissible inputs"]
    assert named == [*expected, "certificates"]


@pytest.mark.slow
def test_a_step_that_is_off_the_equation_of_motion_is_one_of_them():
    judge = judge_of()
    for resolved in (True, False):
        judge.assumptions.moved(steps([0.1], [-1.0])._replace(resolved=np.array([resolved])))
        assert ("resolved motion" in [a.name for a in judge.assumptions.of_guarantee]) != resolved
    assert counted(judge, "resolved motion") == (1, 2, 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("choice", "more"),
    [
        ("information=paper", ["received inputs in force", "truthful broadcasts"]),
        ("information=in-flight", ["received inputs in force", "truthful broadcasts"]),
        ("information=worst-case", []),
        ("control=centralised", ["synchronous sampling"]),
    ],
)
def test_what_the_theorem_rests_on(choice, more):
    always = ["start in S_I", "sampling gap", "disturbance bound", "non-empty K_i", "proven margin"]
    assert [a.name for a in judge_of(f"safety.{choice}").assumptions.of_theorem] == [*always, *more]


def test_a_silent_or_deceived_agent_counts_if_it_is_normal():
    judge, adversary = judge_of(), 4
    for i in (0, adversary):
        happen(judge, Sampled(i, 0.01 * i, truthful=False))
        command(judge, CommandKind.FREEZE, i, 0.1 + 0.01 * i)
    assert counted(judge, "truthful sensors") == (1, 1, 0.0)
    assert counted(judge, "faithful agents") == (1, 1, 0.1)


@pytest.mark.parametrize(("model", "may_turn"), [("unknown", True), ("paper", False)])
def test_others_may_turn_where_rows_count_everyone_at_worst(model, may_turn):
    judge = judge_of(f"safety.information={model}", "safety.composition=pairs")
    apply(judge, 0, origin=Origin.ATTACK, t=0.01)
    assert counted(judge, "faithful agents") == ((0, 1, None) if may_turn else (1, 1, 0.01))
    note = assumption(judge, "faithful agents").note
    assert note.startswith("no normal agent fell silent" + (";" if may_turn else " or turned"))


def test_one_pair_makes_a_start_from_which_the_safe_set_cannot_be_kept():
    apart = judge_of()
    near = judge_of("agents.0.start=[[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [0.0, 9.0, 0.0]]")
    assert counted(apart, "start in S_I") == (0, 1, None)
    assert counted(near, "start in S_I") == (1, 1, 0.0)


def test_an_input_of_an_agent_that_has_applied_none_is_not_in_force():
    judge = judge_of()
    apply(judge, 0, t=0.005, ages=((1, 0.005),))
    assert counted(judge, "received inputs in force") == (1, 1, 0.005)


@pytest.mark.slow
def test_what_actuators_hold_before_their_first_input_has_to_be_in_u_too():
    """The first group's three agents cannot go slower than 1 m/s."""
    going = 'agents.0.dynamics={ type = "tests.unit.plant.test_judge:Going", speed = 4.0, '
    judge = judge_of(going + "turn_rate = 2.0, offset = 0.25 }")
    start = rows_of_scenario("unicycles").swarm.start()
    happen(judge, StateReached(0.0, start, []))
    assert counted(judge, "admissible inputs")[0] == 0, "no time has passed"
    apply(judge, 0, u=(2.0, 0.0))
    for t in (0.01, 0.02, 0.03):
        happen(judge, StateReached(t, start, []))
    assert counted(judge, "admissible inputs") == (2, 5, 0.0), "one check of each agent's input"
    judge = judge_of(going + "turn_rate = 2.0, offset = 0.25 }")
    lost = InputLost(1, 0, 0.0, 0.0, np.array([2.0, 0.0]), report(0))
    reached = [StateReached(t, start, []) for t in (0.0, 0.01)]
    happen(judge, reached[0], applied(0, u=(2.0, 0.0)), lost, reached[1], applied(2, u=(2.0, 0.0)))
    assert counted(judge, "admissible inputs") == (2, 6, 0.0), "the same of events at once"


class Going(Unicycle):
    """It cannot stop."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        A, b = super().input_polytope(x)
        return ca.vertcat(A, ca.SX([[-1.0, 0.0]])), ca.vertcat(b, -1.0)


@pytest.mark.slow
def test_time_may_go_on_until_the_first_certificate_ends_and_no_farther():
    """One pair's ends a second before all others."""
    coverage = judge_of().coverage
    coverage.ends[:], coverage.ends[3] = 2.0, 1.0
    hold(coverage, until=[1.0, 1.25, 1.5])
    certificates, summary = coverage.assumption, coverage.summary
    assert (certificates.failed, certificates.checked, certificates.first) == (2, 3, 1.25)
    assert summary.uncovered_at == 1.0
    coverage.ends[3] = 9.0
    hold(coverage, until=[1.5])
    assert (coverage.least[0], coverage.least[3]) == (0.5, -0.5), "the least that was left"


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, np.nan])
@np.errstate(invalid="ignore")
def test_a_pair_of_which_nothing_is_proven_is_not_certified_even_for_an_instant(seconds):
    coverage = judge_of().coverage
    for i in range(4):
        hold(coverage, i, 1.0, seconds)
    assert (coverage.ends == -np.inf).all()


@pytest.mark.slow
def test_a_given_margin_is_never_called_proven():
    margin = assumption(judge_of(), "proven margin")
    assert margin.failed == 1
    assert "η is a given number" in margin.note


@pytest.mark.slow
def test_leaving_s_i_is_an_assumption_of_its_own_with_when_and_how_deep():
    judge = Judge(rows_of_scenario("formation3d"))

    def see(times: list[float], psi: list[float]) -> None:
        judge.assumptions.moved(steps(times, [-50.0] * len(times), psi))

    see([0.0, 0.1], [-3.0, 0.0])
    assert counted(judge, "stayed in S_I") == (0, 2, None)
    assert "largest" not in assumption(judge, "stayed in S_I").note
    see([0.2, 0.3, 0.4, 0.5], [0.5, 0.75, 0.625, -1.0])
    assert counted(judge, "stayed in S_I") == (3, 6, 0.2)
    assert "the largest was 0.75, at t = 0.300 s" in assumption(judge, "stayed in S_I").note


@pytest.mark.slow
def test_with_relative_degree_1_there_is_nothing_between_h_and_s_i():
    judge = judge_of()
    judge.assumptions.moved(steps([0.0], [-1.0]))
    assert "stayed in S_I" not in [a.name for a in judge.assumptions.of_theorem]


@pytest.mark.slow
def test_an_input_that_is_half_a_millisecond_late_is_late():
    judge = judge_of("time.latency=0.002")
    for late in (0.0, 5e-4):
        apply(judge, 0, t=0.01, t_apply=0.012 + late)
    assert counted(judge, "inputs in time") == (1, 2, 0.0125)


@pytest.mark.slow
def test_an_input_has_to_be_in_u_of_the_state_that_was_sampled():
    """The output's velocity is bound to 4 m/s ahead and .5 m/s aside, of the sampled heading."""
    dynamics = 'agents.0.dynamics={ type = "tests.unit.theory.users_own:OutputUnicycle" }'
    judge = judge_of(dynamics, "time.latency=0.002")
    ahead, aside = start_with(heading=0.0), start_with(heading=np.pi / 2)
    for k, (sampled, applied) in enumerate([(ahead, aside), (aside, ahead)]):
        t = 0.01 * k
        happen(judge, StateReached(t, sampled, []))
        happen(judge, Sampled(0, t))
        happen(judge, StateReached(t + 0.002, applied, []))
        apply(judge, 0, k=k, t=t, t_apply=t + 0.002, u=(4.0, 0.0))
    failed, _, first = counted(judge, "admissible inputs")
    assert (failed, first) == (1, 0.012)


def start_with(heading: float) -> np.ndarray:
    """Simulation 1's start, where the first agent's heading is this [rad]."""
    x = rows_of_scenario("unicycles").swarm.start()
    x[2] = heading
    return x
