"""A pair's certificate: never above zero while it lasts, and never where h can jump above."""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.guarantee.certificate import (
    MULTIPLES,
    PairCertificate,
    highest_within,
    pair_certificate,
)
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import box_polytope
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Body, Separation
from phalanx.theory.safety.obstacles import Box, Obstacle, Polygon, Sphere
from tests.layers import layered
from tests.unit.swarms import swarm_of_scenario
from tests.unit.tables import group, swarm_table

seeds = st.integers(0, 2**32 - 1)
TAU = 0.05


def certificate(dynamics, alphas, function=None, bounds=(0.3, 0.3), tau=TAU):
    members = [Member("a", dynamics, False), Member("b", dynamics, True)]
    pair = compose(members, [], function or Separation(1.0), 1.0).alone(0)
    return pair_certificate(pair, 0, [Linear(a) for a in alphas], bounds, tau)


def certified_time(certificate: PairCertificate, x: np.ndarray, u: np.ndarray) -> float:
    """Return the time for which a pair in state x is certified [s], if agent a holds u."""
    return certificate.times(x[None], u)[0]


@cache
def line() -> PairCertificate:
    """Certify a pair of single integrators."""
    return certificate(SingleIntegrator(1.0), [1.0])


@given(seed=seeds, excess=st.sampled_from([0.0, 1.0]))
def test_two_on_a_line_stay_apart_while_certified_and_not_much_longer(seed, excess):
    """The other and both disturbances push together: d' = u - 1 - 0.6 excess, exactly."""
    rng = np.random.default_rng(seed)
    d, u = rng.uniform(1.0, 1.5), rng.uniform(-1, 1)
    time = certified_time(line(), np.array([d, 0.0, 0.0, 0.0]), np.array([u, 0.0]))
    closing = 1.0 - u + 0.6
    meeting = (d - 1.0) / closing if closing > 0 else np.inf
    assert time <= meeting
    assert time >= 0.8 * min(meeting, TAU)
    assert d + time * (u - 1.0 - 0.6 * excess) >= 1.0 - 1e-12


def test_nothing_is_certified_outside():
    assert certified_time(line(), np.array([0.99, 0.0, 0.0, 0.0]), np.array([1.0, 0.0])) == 0.0
    parting = np.array([0.9, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # ψ_1 < 0
    assert certified_time(double_integrators(1.0), parting, np.array([2.0, 0.0])) == 0.0


def test_far_apart_all_is_certified():
    time = certified_time(line(), np.array([9.0, 0.0, 0.0, 0.0]), np.array([-1.0, 0.0]))
    assert time == MULTIPLES[0] * TAU


@pytest.mark.slow
@given(seed=seeds, gain=st.sampled_from([0.1, 40.0]))
@settings(max_examples=30)
def test_the_last_alpha_has_no_part_in_it(seed, gain):
    rng = np.random.default_rng(seed)
    x, u = rng.uniform(-1, 1, 8), rng.uniform(-2, 2, 2)
    assert certified_time(double_integrators(gain), x, u) == certified_time(
        double_integrators(1.0), x, u
    )


@cache
def double_integrators(gain: float) -> PairCertificate:
    """Certify a pair of them, with this gain of α_2."""
    return certificate(DoubleIntegrator(2.0, 0.5, 2), [1.0, gain])


def test_two_that_part_are_certified_for_longer_by_their_chain_than_by_h_alone():
    x = np.array([1.005, 0.0, 1.135, -0.464, 0.0, 0.0, 0.0, 0.0])
    assert certified_time(double_integrators(1.0), x, np.array([2.0, -2.0])) > 2.5 * TAU


class Jumping:
    """Separation, and a term that jumps above zero where a's x passes 1."""

    def __init__(self, jump) -> None:
        self._jump = jump

    def between(self, a: Body, b: Body) -> ca.SX:
        return 1.0 - ca.sumsqr(a.p - b.p) + 50.0 * self._jump(a.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dynamics", "alphas"),
    [
        (SingleIntegrator(1.0), [1.0]),
        (Unicycle(1.0, 1.0), [1.0]),
        (DoubleIntegrator(1.0, 0.5, 2), [1.0, 1.0]),
        (DoubleIntegrator(1.0, 0.5, 2), [1e-300, 1.0]),  # ψ_1 hardly knows h
    ],
)
def test_a_jump_within_reach_is_never_certified(dynamics, alphas):
    jumping = Jumping(lambda p: ca.sign(p[0] - 1.0) + 1.0)
    pair = certificate(dynamics, alphas, jumping)
    x = np.zeros(2 * len(dynamics.states))
    x[1 - len(dynamics.states)] = 5.0
    u = np.array([1.0, 0.0])
    assert certified_time(pair, x - np.eye(len(x))[0], u) == MULTIPLES[0] * TAU
    near = x.copy()
    near[0] = 1.0 - 1e-6 - (dynamics.offset if isinstance(dynamics, Unicycle) else 0.0)
    assert certified_time(pair, near, u) == 0.0


@pytest.mark.parametrize(
    "jump",
    [
        lambda p: ca.floor(p[0]) - 2.0,
        lambda p: ca.if_else(p[0] > 3.0, 1.0, 0.0),
        lambda p: ca.atan2(p[1], 2.5 - p[0]),
    ],
    ids=["floor", "comparison", "bearing"],
)
def test_a_jump_without_a_derivative_is_never_certified_either(jump):
    """Jumps by 1 or more at (3, 0), each of which takes h above zero."""
    pair = certificate(SingleIntegrator(1.0), [1.0], Jumping(jump))
    ahead = np.array([1.0, 1.0])
    assert certified_time(pair, np.array([-5.4, 0.0, 0.0, 0.0]), ahead) > 0.0
    assert certified_time(pair, np.array([3.0 - 1e-6, -1e-6, 0.0, 0.0]), ahead) == 0.0
    assert not pair.refused


@pytest.mark.parametrize(
    ("jump", "name"),
    [
        (lambda p: ca.fmod(p[0], 2.0), "fmod"),
        (lambda p: ca.copysign(1.0, p[0]), "copysign"),
        (lambda p: ca.remainder(p[0], 2.0), "remainder"),
    ],
)
def test_what_has_no_interval_rule_is_refused_by_its_name(jump, name):
    pair = certificate(SingleIntegrator(1.0), [1.0], Jumping(jump))
    assert certified_time(pair, np.array([-9.0, 0.0, 0.0, 0.0]), np.zeros(2)) == 0.0
    assert f"no interval rule for the operation {name}" in pair.refused


@pytest.mark.parametrize("h", [lambda s: ca.log(s) - 5.0, lambda s: ca.sqrt(s) - 5.0])
def test_nothing_is_certified_where_h_may_not_be_a_number(h):
    pair = certificate(SingleIntegrator(1.0), [1.0], Along(h), (0.0, 0.0))
    assert certified_time(pair, np.array([3.0, 0.0, 0.0, 0.0]), np.zeros(2)) == MULTIPLES[0] * TAU
    close = certified_time(pair, np.array([0.04, 0.0, 0.0, 0.0]), np.zeros(2))
    assert close <= 0.04


class Along:
    """h is a function of how far a is ahead of b."""

    def __init__(self, h) -> None:
        self._h = h

    def between(self, a: Body, b: Body) -> ca.SX:
        return self._h(a.p[0] - b.p[0])

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)


def test_without_an_enclosure_nothing_is_certified():
    """Positions of which even the box is infinite."""
    pair = certificate(DoubleIntegrator(1e200, 1e200, 2), [1.0, 1.0])
    assert certified_time(pair, np.array([50.0, 0, 0, 0, 0, 0, 0, 0]), np.zeros(2)) == 0.0


class Exploding:
    """x' = x² + u and y' = 0: from x = 10 on there is no state after .1 s."""

    states, inputs = ("x", "y"), ("u",)

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[0] * x[0], 0)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.SX([1, 0])

    def position(self, x: ca.SX) -> ca.SX:
        return x

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((1.0,))


def test_nothing_is_certified_for_longer_than_there_is_a_state():
    """The other agent is far aside: no box that is computed comes near it."""
    pair = certificate(Exploding(), [1.0], bounds=(0.0, 0.0))
    x = np.array([10.0, 0.0, 10.0, 100.0])
    assert certified_time(pair, x, np.zeros(1)) < 0.1
    members = [Member(name, Exploding(), False) for name in "ab"]
    alone = compose(members, [], Separation(1.0), 1.0).alone(0)
    bounds = [highest_within(alone, (0.0, 0.0), T) for T in (1e-3, 0.2)]
    highest = CompiledFunction([alone.x], [ca.vertcat(*bounds)])(x)[0]
    assert highest[0] < 0.0
    assert highest[1] == np.inf


@pytest.mark.parametrize(
    ("dynamics", "alphas", "scale"),
    [(SingleIntegrator(1e-6), [1.0], 1e-6), (SingleIntegrator(3000.0), [1.0], 1.0)],
)
def test_small_lengths_and_great_speeds_are_no_exception(dynamics, alphas, scale):
    pair = certificate(dynamics, alphas, Separation(scale), (0.0, 0.0))
    d = 1.5 * scale
    time = certified_time(pair, np.array([d, 0.0, 0.0, 0.0]), np.zeros(2))
    assert d - time * dynamics.speed >= scale


@pytest.fixture(scope="module")
def swarm():
    return swarm_of_scenario("unicycles")


@pytest.mark.slow
def test_an_agents_certificates_are_those_of_its_pairs(swarm, rng):
    every = SwarmCertificates(swarm)
    for i in swarm.normal:
        certificates = every.of(i)
        composed = swarm.safe_set
        h = CompiledFunction([composed.x], [composed.h])
        for _ in range(20):
            x = swarm.start() + rng.uniform(-3, 3, composed.x.numel())
            u = rng.uniform(-1, 1, 2) * [4.0, 2.0]
            times = certificates(x, u)
            inside = h(x)[0][list(certificates.pairs)] <= 0
            assert times.shape == (7,)
            assert (times[~inside] == 0).all()
            assert (times <= MULTIPLES[0] * certificates.tau).all()
            assert ((times > 0) | (h(x)[0][list(certificates.pairs)] > -1.0)).all()
    # Either side of two normal agents; with an adversary, and with a sphere.
    assert len(every.kinds) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", layered(("unicycles", "formation3d", "swarm"), ("unicycles", "formation3d"))
)
def test_of_several_inputs_at_once_as_much_is_proven_as_of_each_alone(name, rng):
    """Inputs of agents of different kinds and in different states, with pairs left out or not.

    Some are so near that what is proven depends on the input.
    """
    swarm = swarm_of_scenario(name)
    every = SwarmCertificates(swarm)
    cases, near_enough = [], 0
    for i in [*swarm.normal, *swarm.normal[:2]]:
        agent, size = every.of(i), len(swarm.members[i].dynamics.inputs)
        x = 0.2 * swarm.start() + rng.uniform(-3, 3, swarm.safe_set.x.numel())
        near = rng.random(len(agent.pairs)) < (1.0 if i % 2 else 0.5)
        cases.append((agent, x, np.append(rng.uniform(-1, 1, size), np.zeros(3 - size)), near))
    agents, x, u, near = zip(*cases, strict=True)
    sides = [agent.every_side[some] for agent, some in zip(agents, near, strict=True)]
    inputs = np.arange(len(cases)).repeat([len(part) for part in sides])
    proven = every.proven(np.concatenate(sides), inputs, np.array(x), np.array(u))
    for n, (agent, x, u, near) in enumerate(cases):
        times = agent(x, u, near)
        assert (times[near] == proven[inputs == n]).all()
        assert (times[~near] == agent.longest).all()
        near_enough += np.count_nonzero((times > 0.0) & (times < agent.longest))
    assert near_enough > 2


def boosted(gain: float) -> Swarm:
    """Agent 1, and agent 2 that is 3 m from it, of dynamics that are equal by `==`, with a gain."""
    dynamics = {"type": "tests.unit.theory.users_own:Boosted", "speed": 1.0}
    agents = [
        group(str(k + 1), "normal", [[3.0 * k, 0.0]], dynamics=dynamics | {"gain": each})
        for k, each in enumerate((1.0, gain))
    ]
    table = swarm_table(*agents, safety={"rho": 1.0, "eta": 0.0})
    return build_swarm(load(table))


def test_a_certificate_is_of_a_pairs_own_dynamics_whatever_equals_them():
    """Agent 2 may come 2 m nearer within 67 ms with gain 30, and not in 2 s with gain 1."""
    for gain, least in ((1.0, 0.08), (30.0, 0.0), (1.0, 0.08)):
        swarm = boosted(gain)
        (time,) = SwarmCertificates(swarm).of(0)(swarm.start(), np.zeros(2))
        assert least <= time <= 2.0 / gain


def test_obstacles_are_pairs_too():
    members = [Member("a", SingleIntegrator(1.0), False)]
    pair = compose(members, [Sphere((3.0, 0.0), 1.0)], Separation(1.0), 1.0).alone(0)
    certificate = pair_certificate(pair, 0, [Linear(1.0)], [0.3], TAU)
    time = certified_time(certificate, np.array([1.9, 0.0]), np.array([1.0, 0.0]))
    assert 0.9 * 0.1 / 1.3 < time <= 0.1 / 1.3


@pytest.mark.parametrize(
    "obstacle",
    [
        Box((3.0, 0.0), (2.0, 2.0), 0.5, rounding=0.01),
        Polygon(((2.0, -1.0), (2.0, 1.0), (4.0, 1.5)), 0.5, rounding=0.01),
    ],
    ids=["box", "polygon"],
)
def test_one_is_certified_up_to_where_the_smooth_distance_is_the_clearance(obstacle):
    swarm = compose([Member("a", SingleIntegrator(1.0), False)], [obstacle], Separation(1.0), 1.0)
    certificate = pair_certificate(swarm.alone(0), 0, [Linear(1.0)], [0.3], TAU)
    x, u = np.array([[1.47, 0.3]]), np.array([1.0, 0.0])
    time = certified_time(certificate, x[0], u)
    assert time > 0.0
    assert obstacle.distances(x + 1.3 * time * u)[0] >= obstacle.clearance
    assert obstacle.distances(x + 1.25 * 1.3 * time * u)[0] < obstacle.clearance


@given(seed=seeds)
def test_an_agent_does_not_reach_a_polygon_while_it_is_certified(seed):
    """Its true distance stays above the clearance, with a disturbance in any direction."""
    rng = np.random.default_rng(seed)
    polygon = Polygon(((0.0, 0.0), (2.0, 0.5), (1.0, 2.0), (-0.5, 1.0)), 0.3)
    p, angle = rng.normal(1.0, 2.0, 2), rng.uniform(0.0, 2.0 * np.pi)
    u = np.array([np.cos(angle), np.sin(angle)]) / np.sqrt(2.0)
    time = certified_time(_beside(polygon), p, u)
    pushes = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 24)])
    ends = p + time * (u + 0.3 * pushes)
    assert time == 0.0 or polygon.distances(ends).min() >= polygon.clearance - 1e-9
    if polygon.distances(p[None])[0] > polygon.clearance + 1.0 * TAU * 3.0:
        assert time > TAU


@cache
def _beside(polygon: Polygon) -> PairCertificate:
    """Certify a single integrator near a polygon."""
    swarm = compose([Member("a", SingleIntegrator(1.0), False)], [polygon], Separation(1.0), 1.0)
    return pair_certificate(swarm.alone(0), 0, [Linear(1.0)], [0.3], TAU)


class Port:
    """h = 835 unless the other is on the port side, by the sign of the sine of its heading."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return ca.if_else(ca.sin(b.p[1]) > 0, -1.0, 835.0) + 1e-3 * (a.p[0] + b.p[0])

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return ca.SX(-1.0)


@dataclass(frozen=True)
class Railed(SingleIntegrator):
    """Only along x can it move."""

    def actuation(self, x):
        return ca.SX(ca.DM([[1.0, 0.0], [0.0, 0.0]]))


def test_the_sign_of_a_sine_of_nought_proves_nothing():
    railed = certificate(Railed(1.0), [1.0], Port(), bounds=(0.0, 0.0))
    assert certified_time(railed, np.zeros(4), np.zeros(2)) == 0.0
    assert certified_time(railed, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(2)) == MULTIPLES[0] * TAU


@pytest.mark.slow
@pytest.mark.parametrize("drag", [0.85, 0.95, 2.0, 40.0])
def test_no_drag_is_too_strong_for_a_certificate_far_apart(drag):
    """τ is 1 s; 300 m apart, no two agents can meet."""
    far = certificate(DoubleIntegrator(2.0, drag, 2), [1.0, 1.0], bounds=(0.1, 0.1), tau=1.0)
    x = np.array([0.0, 0.0, 1.0, 0.0, 300.0, 0.0, -1.0, 0.0])
    assert certified_time(far, x, np.zeros(2)) == MULTIPLES[0]
