"""Safe-set functions in metres: hand formulas, finite differences, and what they are for."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Distance, HeadingAware
from phalanx.theory.safety.obstacles import Obstacle, Sphere, Wall

R, KAPPA, B = 1.3, 2.0, 0.25
UNICYCLE = Unicycle(4.0, 2.0, B)
SPHERE, WALL = Sphere((1.0, -2.0), 1.25), Wall((3.0, 4.0), 6.0, 0.5)
seeds = st.integers(0, 2**32 - 1)


def pair(function, dynamics: Dynamics, *obstacles: Obstacle, adversary: bool = True) -> ComposedSet:
    """One normal agent, another, obstacles."""
    members = [Member("a", dynamics, False), Member("b", dynamics, adversary)]
    return compose(members, obstacles, function, 5.0)


def values(composed: ComposedSet, x: np.ndarray) -> np.ndarray:
    return np.array(ca.Function("h", [composed.x], [composed.h])(x)).ravel()


def gradients(composed: ComposedSet, x: np.ndarray) -> np.ndarray:
    gradient = ca.jacobian(composed.h, composed.x)
    return np.array(ca.Function("g", [composed.x], [gradient])(x))


def by_differences(composed: ComposedSet, x: np.ndarray) -> np.ndarray:
    step = 1e-6 * np.eye(len(x))
    return np.array([(values(composed, x + s) - values(composed, x - s)) / 2e-6 for s in step]).T


def state(seed: int, size: int) -> np.ndarray:
    """The agents some way apart from one another and from the sphere."""
    x = np.random.default_rng(seed).uniform(-1.5, 1.5, size)
    x[1] += 4.0
    x[size // 2] += 6.0
    return x


@given(seed=seeds)
def test_distance_is_the_hand_formula_and_its_gradient_has_length_one(seed):
    x = state(seed, 8)
    composed = pair(Distance(R), DoubleIntegrator(1.0, 0.5, dimension=2), SPHERE, WALL)
    p, other = x[:2], x[4:6]
    away = p - np.array(SPHERE.center)
    expected = [
        R - np.hypot(*(p - other)),
        1.25 - np.hypot(*away),
        0.5 - (6.0 - (3.0 * p[0] + 4.0 * p[1]) / 5.0),
    ]
    assert values(composed, x) == pytest.approx(expected, rel=1e-12)
    slopes = gradients(composed, x)
    assert np.linalg.norm(slopes[:, :2], axis=1) == pytest.approx(1.0)
    assert slopes == pytest.approx(by_differences(composed, x), abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("adversary", [True, False])
@given(seed=seeds)
def test_heading_aware_is_the_hand_formula(adversary, seed):
    x = state(seed, 6)
    composed = pair(HeadingAware(R, KAPPA), UNICYCLE, SPHERE, WALL, adversary=adversary)
    heads = [np.array([np.cos(t), np.sin(t)]) for t in (x[2], x[5])]
    p, other = x[:2] + B * heads[0], x[3:5] + B * heads[1]

    def cosine(head, away):
        return head @ away / np.hypot(*away)

    between = cosine(heads[0], p - other)
    if not adversary:
        between = (between + cosine(heads[1], other - p)) / 2
    from_sphere = p - np.array(SPHERE.center)
    expected = [
        R + KAPPA * (1 - between) - np.hypot(*(p - other)),
        1.25 + KAPPA * (1 - cosine(heads[0], from_sphere)) - np.hypot(*from_sphere),
        0.5 + KAPPA * (1 + heads[0] @ [0.6, 0.8]) - (6.0 - p @ [0.6, 0.8]),
    ]
    # Two normal agents, or an adversary: then with all the obstacles of both.
    assert values(composed, x)[0] == pytest.approx(expected[0], rel=1e-12)
    pairs_of_a = [n for n, each in enumerate(composed.pairs) if each.a == 0]
    assert values(composed, x)[pairs_of_a] == pytest.approx(expected, rel=1e-12)
    assert gradients(composed, x) == pytest.approx(by_differences(composed, x), abs=1e-6)


@pytest.mark.slow
def test_wherever_it_faces_a_unicycle_can_open_its_distance_at_nearly_full_speed():
    """Effect of its best input on h' by heading; with h = R - d it is ωb side-on."""

    def authority(function, theta: float) -> float:
        composed = pair(function, UNICYCLE)
        # The other stands still at the origin, the output point 2 m to its right.
        x = np.array([2.0 - B * np.cos(theta), -B * np.sin(theta), theta, -B, 0.0, 0.0])
        slope = gradients(composed, x)[0, :3]
        return 4.0 * abs(slope[0] * np.cos(theta) + slope[1] * np.sin(theta)) + 2.0 * abs(slope[2])

    headings = np.linspace(-np.pi, np.pi, 181)
    assert min(authority(HeadingAware(1.0, KAPPA), t) for t in headings) > 3.0
    assert min(authority(Distance(1.0), t) for t in headings) == pytest.approx(2.0 * B, abs=0.01)


def test_no_other_dynamics_has_a_heading():
    with pytest.raises(ValueError, match="unicycles, with states x, y, theta; got x, y"):
        assert pair(HeadingAware(R, KAPPA), SingleIntegrator(1.0)).h.numel()
    point = '{ type = "single-integrator", speed = 4.0 }'
    scenario = load("heading-aware", [f"agents.0.dynamics={point}", "agents.0.spread=[0, 0]"])
    with pytest.raises(ScenarioError, match="heading-aware needs normal agents that are unicycles"):
        build_swarm(scenario)


def test_an_adversary_may_be_anything():
    members = [Member("a", UNICYCLE, False), Member("b", SingleIntegrator(1.0), True)]
    assert compose(members, [], HeadingAware(R, KAPPA), 5.0).h.numel() == 1
