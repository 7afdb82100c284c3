"""Margins are bounds, shares add up, and inputs count only while they are in force."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, extend
from phalanx.theory.margins.constants import constants
from phalanx.theory.margins.local import UNKNOWN, local_margin
from phalanx.theory.models.bicycle import KinematicBicycle
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.polytope import constant_polytope, polytope
from phalanx.theory.models.unicycle import Unicycle
from phalanx.theory.rows.decision import decide_pairs, least_violation
from phalanx.theory.rows.information import Information, InformationModel, ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import HALF, PairTermsFunction, own_pairs, pair_rows
from phalanx.theory.rows.qp import TOLERANCE, NearestInput
from phalanx.theory.rows.row import Rows
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Body, Separation
from phalanx.theory.safety.obstacles import Sphere

seeds = st.integers(0, 2**32 - 1)
PHI = [0.4, 0.7, 0.2]


def expressions(x: ca.SX) -> list[ca.SX]:
    return [
        x[0] * x[1] - x[0] / (2.0 + x[2] ** 2),
        ca.sin(x[0]) * ca.cos(3 * x[1]) + ca.exp(-x[2]),
        ca.sqrt(1 + ca.sumsqr(x)) * ca.fabs(x[1]),
        ca.fmax(x[0], x[1]) - ca.fmin(x[1], x[2]) + ca.sign(x[2]) * ca.fabs(x[2]) ** 3,
        ca.log(2.0 + ca.cos(x[0])) / (x[1] - 10.0),
        x[0] ** 3 - x[1] ** 4 + ca.fabs(x[2]) ** 1.5 + (x[2] - 20.0) ** -3,
    ]


@given(seed=seeds)
@settings(max_examples=50, deadline=None)
def test_an_interval_extension_holds_every_value_over_the_box(seed):
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 3)
    low = rng.uniform(-4, 4, 3)
    high = low + rng.exponential(1.0, 3)
    box = [Interval(ca.SX(a), ca.SX(b)) for a, b in zip(low, high, strict=True)]
    bounds = extend(expressions(x), ca.vertsplit(x), box)
    lows, highs = (np.array(ca.DM(ca.vertcat(*side))).ravel() for side in zip(*bounds, strict=True))
    values = CompiledFunction([x], [ca.vertcat(*expressions(x))])
    for _ in range(50):
        value = values(rng.uniform(low, high))[0]
        assert (lows <= value + 1e-12 * (1 + abs(value))).all()
        assert (value <= highs + 1e-12 * (1 + abs(value))).all()


def test_the_extension_of_a_line_is_exact():
    x = ca.SX.sym("x")
    (bound,) = extend([2 - 3 * x], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert (float(bound.lo), float(bound.hi)) == (-4.0, 5.0)


def test_division_by_what_may_be_zero_is_unbounded():
    x = ca.SX.sym("x")
    (bound,) = extend([1 / x], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert (float(bound.lo), float(bound.hi)) == (-np.inf, np.inf)


def test_zero_times_what_is_unbounded_is_unbounded_and_not_forgotten():
    """Ends that are symbols, as in a margin: CasADi must not simplify the question away."""
    x, y, ends = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("ends", 4)
    box = [Interval(ends[0], ends[1]), Interval(ends[2], ends[3])]
    (bound,) = extend([ca.fmax(x / y, -5)], [x, y], box)
    high = CompiledFunction([ends], [bound.hi])
    assert high(np.array([0.0, 0.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, 1.0, 2.0]))[0][0] == 3.0


def test_an_operation_without_a_rule_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(UnboundedOperationError, match="no interval rule"):
        extend([ca.atan2(x, 2.0)], [x], [Interval(ca.SX(0), ca.SX(1))])


CASES = {
    "single integrators": (SingleIntegrator(1.5), [1.3], 0.05),
    "unicycles": (Unicycle(4.0, 2.0), [2.0], 0.012),
    "double integrators": (DoubleIntegrator(2.0, 0.5, 2), [0.6, 0.9], 0.05),
    "bicycles": (KinematicBicycle(2.0, 0.7), [0.6, 0.9], 0.02),
}


def field_of(member: Member):
    x = ca.SX.sym("x", len(member.dynamics.states))
    u = ca.SX.sym("u", len(member.dynamics.inputs))
    rate = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u
    return CompiledFunction([x, u], [rate])


class Pair:
    """Two agents, the second perhaps an adversary, with the row of the first."""

    def __init__(self, name: str, share: float | None) -> None:
        dynamics, alphas, self.horizon = CASES[name]
        members = [Member("a", dynamics, False), Member("b", dynamics, share is None)]
        self.set = compose(members, [], Separation(1.0), 1.0)
        chain = build_chain(self.set, alphas, None, PHI[:2])
        self.n, self.m = len(dynamics.states), len(dynamics.inputs)
        self.corners = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", self.n))).corners
        u, w = ca.SX.sym("u", self.m), ca.SX.sym("w", self.m)
        part = 1.0 if share is None else share
        row = chain.actuation[0] @ u + part * (ca.sum1(chain.drift) + chain.alpha)
        if share is None:
            row += chain.actuation[1] @ w
        outputs = [self.set.substitute(e) for e in (row, part * chain.disturbance)]
        self.row = CompiledFunction([self.set.x, u, w], outputs)
        margin = local_margin(chain, 0, self.horizon, PHI[:2], share)
        self.margin = CompiledFunction([self.set.x], [margin])
        self.field = field_of(members[0])


class Kinked:
    """h = 1 - d_y + |d_x|, with d = p_a - p_b: its gradient jumps where d_x = 0."""

    def between(self, a: Body, b: Body) -> ca.SX:
        apart = a.p - b.p
        return 1.0 - apart[1] + ca.fabs(apart[0])


def test_there_is_no_margin_where_a_kink_of_h_is_within_reach():
    """Across it L_g h jumps, which no rate of it bounds."""
    members = [Member(name, SingleIntegrator(1.0), False) for name in "ab"]
    chain = build_chain(compose(members, [], Kinked(), 1.0), [1.0], None, [0.0, 0.0])
    margin = CompiledFunction([chain.set.x], [local_margin(chain, 0, 0.1, [0.0, 0.0], HALF)])
    assert margin(np.array([0.15, 0.0, 0.0, 0.0]))[0] == UNKNOWN
    assert margin(np.array([0.35, 0.0, 0.0, 0.0]))[0] < 1.0
    low, high = np.full(4, -1.0), np.full(4, 1.0)
    found = constants(chain, low, high, [0.0, 0.0], np.zeros((1, 4)))
    assert found["c_g"].how == "sampled"


PAIRS = {(name, share): Pair(name, share) for name in CASES for share in (None, HALF)}


@pytest.mark.parametrize("share", [None, HALF])
@pytest.mark.parametrize("name", CASES)
@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_the_local_margin_covers_every_drift_of_the_row_until_the_next_sample(name, share, seed):
    """Against trajectories whose inputs and disturbances are drawn anew all the time."""
    pair, rng = PAIRS[name, share], np.random.default_rng(seed)
    x = rng.uniform(-3, 3, 2 * pair.n)
    margin = float(pair.margin(x)[0][0])
    corners = pair.corners
    u, w = (corners[rng.integers(len(corners))] for _ in range(2))
    before = float(pair.row(x, u, w)[0][0])
    steps = 20
    for _ in range(steps):
        phi = [bound * unit(rng, pair.n) for bound in PHI[:2]]
        other = corners[rng.integers(len(corners))]
        rates = [pair.field(x[: pair.n], u)[0] + phi[0], pair.field(x[pair.n :], other)[0] + phi[1]]
        x = x + pair.horizon / steps * np.concatenate(rates)
        row, disturbance = (float(v[0]) for v in pair.row(x, u, w))
        assert row - before + disturbance <= margin


def unit(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.normal(size=n)
    return v / np.linalg.norm(v)


def test_without_an_enclosure_the_margin_is_beyond_every_row():
    """A bicycle that may turn by many radians before it samples again."""
    members = [Member("a", KinematicBicycle(50.0, 50.0, 0.01), False)]
    composed = compose(members, [Sphere((5.0, 0.0), 1.0)], Separation(1.0), 1.0)
    chain = build_chain(composed, [1.0, 1.0], None, [1.0])
    margin = CompiledFunction([composed.x], [local_margin(chain, 0, 10.0, [1.0], None)])
    assert margin(np.array([0.0, 0.0, 0.0, 20.0]))[0][0] >= UNKNOWN


DOUBLE = DoubleIntegrator(2.0, 0.5, 2)


@given(seed=seeds)
def test_the_corrected_row_bounds_the_disturbance_in_psi_1(seed):
    """D_2 = Σ ‖∂ψ_1/∂x_l‖ φ_l^max; for one pair ∂ψ_1/∂x_a = (-2 V - 2 α_1 D, -2 D)."""
    members = [Member("a", DOUBLE, False), Member("b", DOUBLE, True)]
    composed = compose(members, [], Separation(1.0), 1.0)
    x = np.random.default_rng(seed).uniform(-3, 3, 8)
    d, v = x[:2] - x[4:6], x[2:4] - x[6:]
    printed = build_chain(composed, [0.6, 0.9], 3.0)
    corrected = build_chain(composed, [0.6, 0.9], 3.0, PHI[:2])
    outputs = [composed.substitute(e) for e in (corrected.disturbance, corrected.psi[1])]
    value = CompiledFunction([composed.x], outputs)
    slope = np.linalg.norm(np.concatenate([-2 * v - 2 * 0.6 * d, -2 * d]))
    assert value(x)[0] == pytest.approx([slope * sum(PHI[:2])], rel=1e-6)
    psi_1 = -2 * d @ v + 3.0 + 0.6 * (1 - d @ d)
    assert value(x)[1] == pytest.approx([psi_1])
    assert printed.disturbance.is_zero()


def swarm_pairs():
    members = [
        Member("a", SingleIntegrator(2.0), False),
        Member("b", SingleIntegrator(2.0), False),
        Member("c", SingleIntegrator(1.0), True),
    ]
    composed = compose(members, [Sphere((0.0, 5.0), 1.0)], Separation(1.0), 1.0)
    chains = {p: build_chain(composed.alone(p), [1.5]) for p in range(len(composed.pairs))}
    return composed, chains


COMPOSED, CHAINS = swarm_pairs()


def own_terms(i: int):
    pairs = own_pairs(COMPOSED, CHAINS, i)
    return pairs, PairTermsFunction(COMPOSED, pairs, [(0.0, 0.0)] * len(pairs), None)


OWN = {i: own_terms(i) for i in (0, 1)}


@given(seed=seeds)
def test_the_halves_of_two_normal_agents_add_up_to_their_pairs_condition(seed):
    x, eta = np.random.default_rng(seed).uniform(-3, 3, 6), 0.8
    rows = {}
    for i in (0, 1):
        pairs, function = OWN[i]
        rows[i] = pair_rows(function(x), pairs, {}, [0, 1], eta)
    d = x[:2] - x[2:4]
    assert rows[0].a[0] == pytest.approx(-2 * d)
    assert rows[1].a[0] == pytest.approx(2 * d)
    condition = 1.5 * (1 - d @ d) + eta
    assert rows[0].bound[0] + rows[1].bound[0] == pytest.approx(-condition)


@given(seed=seeds)
def test_a_pair_with_an_adversary_or_an_obstacle_is_the_normal_agents_alone(seed):
    x, eta = np.random.default_rng(seed).uniform(-3, 3, 6), 0.8
    pairs, function = OWN[0]
    rows = pair_rows(function(x), pairs, {}, [0, 1], eta)
    d, o = x[:2] - x[4:], x[:2] - np.array([0.0, 5.0])
    worst = 2 * np.abs(d).sum()
    assert [p.other for p in pairs] == [1, 2, None]
    assert rows.bound[1] == pytest.approx(-(1.5 * (1 - d @ d) + worst + eta))
    assert rows.bound[2] == pytest.approx(-(1.5 * (1 - o @ o) + eta))
    assert rows.a[2] == pytest.approx(-2 * o)


def test_a_neighbour_that_shares_no_more_counts_at_its_worst_and_a_received_input_as_it_is():
    x = np.array([0.0, 0.0, 1.5, 0.0, 9.0, 9.0])
    pairs, function = OWN[0]
    terms = function(x)
    alpha = 1.5 * (1 - 2.25)
    alone = pair_rows(terms, pairs, {}, [0], 0.0)
    assert alone.bound[0] == pytest.approx(-(alpha + 3.0 * 2.0 + 0.0))
    told = pair_rows(terms, pairs, {1: np.array([0.5, -1.0])}, [], 0.0)
    assert told.bound[0] == pytest.approx(-(alpha - 3.0 * 0.5))


PLENTY = InformationModel(Information.IN_FLIGHT, {0: 0.008, 1: 0.008}, 1.0)


def test_in_flight_trusts_an_input_only_while_no_newer_one_can_be_in_force():
    heard = {1: ReceivedInput(np.ones(2), 0.5)}
    assert list(PLENTY.usable(heard, 0.5079)) == [1]
    assert list(PLENTY.usable(heard, 0.5081)) == []


def test_in_flight_does_not_trust_the_input_of_an_agent_that_may_sample_at_this_very_instant():
    assert PLENTY.usable({1: ReceivedInput(np.ones(2), 0.1)}, 0.1 + 0.008) == {}


@pytest.mark.parametrize("information", [Information.SPLIT, Information.WORST_CASE])
def test_split_and_worst_case_count_on_no_received_input(information):
    trust = InformationModel(information, {0: 0.008, 1: 0.008}, 1.0)
    assert trust.usable({1: ReceivedInput(np.ones(2), 0.0)}, 0.0) == {}


def test_a_silent_neighbour_is_counted_on_no_more():
    heard = {1: ReceivedInput(np.ones(2), 0.5)}
    paper = InformationModel(Information.PAPER, {0: 0.008, 1: 0.008}, 1.0)
    assert list(paper.usable(heard, 1.4)) == [1]
    assert list(paper.usable(heard, 1.6)) == []
    split = InformationModel(Information.SPLIT, {0: 0.008, 1: 0.008}, 1.0)
    assert split.sharing(0, {}, 0.9) == [0, 1]
    assert split.sharing(0, {}, 1.1) == [0]
    assert split.sharing(0, heard, 1.4) == [0, 1]
    assert split.sharing(0, heard, 1.6) == [0]


SQUARE = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))


@given(seed=seeds)
@settings(max_examples=60, deadline=None)
def test_the_qp_with_several_rows_keeps_them_all_and_is_nearest(seed):
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-0.8, 0.8, 2)
    a = rng.normal(size=(3, 2))
    rows = Rows(a, a @ inside + rng.uniform(0.0, 0.3, 3))
    u_nom = rng.uniform(-2, 2, 2)
    decision = decide_pairs(SQUARE, rows, u_nom, NearestInput((1.0, 1.0), 4, 3))
    assert decision.origin is Origin.QP
    sizes = np.linalg.norm(a, axis=1)
    assert ((a @ decision.u - rows.bound) / sizes <= 2 * TOLERANCE).all()
    # u is the projection of u_nom onto a convex set: no point of the set lies beyond it.
    others = rng.uniform(-1, 1, (400, 2))
    feasible = others[(others @ a.T <= rows.bound).all(axis=1)]
    assert ((feasible - decision.u) @ (u_nom - decision.u) <= 1e-4).all()


@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_with_no_solution_the_backup_has_the_least_worst_violation(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(3, 2))
    rows = Rows(a, (a @ SQUARE.corners.T).min(axis=1) - rng.uniform(0.1, 1.0, 3))
    decision = decide_pairs(SQUARE, rows, np.zeros(2), NearestInput((1.0, 1.0), 4, 3))
    assert decision.origin is Origin.BACKUP
    others = rng.uniform(-1, 1, (400, 2))
    assert decision.residual <= ((others @ a.T) - rows.bound).max(axis=1).min() + 1e-9


@given(seed=seeds)
@settings(max_examples=200, deadline=None)
def test_there_is_a_backup_even_where_no_margin_is_known(seed):
    rng = np.random.default_rng(seed)
    rows = Rows(rng.normal(size=(6, 2)) * 10, rng.uniform(-40, 40, 6) - UNKNOWN)
    u = least_violation(SQUARE, rows)
    others = rng.uniform(-1, 1, (50, 2))
    best = ((others @ rows.a.T) - rows.bound).max(axis=1).min()
    assert ((rows.a @ u) - rows.bound).max() <= best + 1e-3


def test_where_no_pair_is_near_the_nominal_input_is_applied_and_every_number_is_finite():
    rows = Rows(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([np.inf, np.inf]))
    u_nom = np.array([0.3, -0.2])
    decision = decide_pairs(SQUARE, rows, u_nom, NearestInput((1.0, 1.0), 4, 2))
    assert decision.u == pytest.approx(u_nom)
    assert np.isfinite(decision.residual)


def test_the_backup_ignores_pairs_outside_the_neighbourhood():
    rows = Rows(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([-5.0, np.inf]))
    assert least_violation(SQUARE, rows)[0] == pytest.approx(-1.0)


def test_an_agents_rows_have_the_margin_of_its_own_place_until_it_samples_again():
    """Γ_i + δ_i^max and the latency: for so long its input may be in force."""
    late = ["time.latency=0.003", "agents.0.clock.jitter=0.001"]
    swarm = build_swarm(load("guaranteed", late))
    x = swarm.start()
    bounds = [group.disturbance.bound for _, group, _ in swarm.scenario.roster()]
    for i in swarm.normal:
        clock = swarm.group(i)[0].clock
        horizon = clock.period + 0.001 + 0.003
        terms, pairs = swarm.pair_terms(i)(x), swarm.own_pairs(i)
        for k, pair in enumerate(pairs):
            members = [swarm.names.index(m.name) for m in pair.chain.set.members]
            assert members[pair.own] == i
            phi = [bounds[l] for l in members]
            shares = [(None, terms.margin), *([(HALF, terms.half_margin)] if pair.shared else [])]
            for share, found in shares:
                own = local_margin(pair.chain, pair.own, horizon, phi, share)
                state = np.concatenate([x[swarm.chain.set.parts[l]] for l in members])
                expected = CompiledFunction([pair.chain.set.x], [own])(state)[0]
                assert found[k] == pytest.approx(expected[0])


def test_for_q_1_the_corrected_margin_is_the_papers_and_for_q_2_no_disturbance_counts_twice():
    same = {
        m: build_swarm(load("unicycles", [f"safety.margin={m}"])) for m in ("paper", "corrected")
    }
    x = same["paper"].start()
    paper, corrected = (swarm.terms(0)(x) for swarm in same.values())
    assert paper.margin == corrected.margin == 0.0
    eta = "safety.eta={c_f=0.0, c_g=0.0, c_alpha=0.0, c_gamma=0.0, c_h=9.0, u_max=1.0, mu=1.0}"
    assert build_swarm(load("unicycles", [eta])).eta(0) == pytest.approx(9.0 * 5 * 1.73)
    assert build_swarm(load("formation3d", [eta])).eta(0) == 0.0
