"""Random windows of true motions: inputs from U, disturbances at their bound, samples off."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope

STEPS = 6
"""Runge-Kutta steps in each part of a window."""


class Windows(NamedTuple):
    """Arguments of MotionCheck.excess."""

    before: Array
    after: Array
    u: Array
    seconds: Array


def corners(dynamics: Dynamics) -> Array:
    x = ca.SX.sym("x", len(dynamics.states))
    polytope = constant_polytope(*dynamics.input_polytope(x))
    assert polytope is not None
    return polytope.corners


def unit(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    found: Array = random.normal(size=shape)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def windows(
    dynamics: Dynamics,
    bound: float,
    error: float,
    count: int,
    random: np.random.Generator,
    longest: float = 0.04,
    false: float = 0.0,
    shortest: float = 1e-3,
    size: float = 3.0,
) -> Windows:
    """Motions of 1 to 40 ms in two parts, with a constant disturbance at its bound in each step.

    Args:
        false: the announced input is off by up to this share of U, in the second part.
        shortest: least length [s]; below 1e-3 all orders of magnitude are as frequent.
        size: of the states at most.
    """
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    rate = ca.Function("rate", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    n, chosen = x.numel(), corners(dynamics)
    weights = random.dirichlet(0.3 * np.ones(len(chosen)), size=(count, 2))
    inputs = weights @ chosen
    state = random.uniform(-size, size, size=(count, n))
    if shortest < 1e-3:
        orders = np.log([shortest / 2.0, longest / 2.0])
        seconds = np.exp(random.uniform(*orders, size=(count, 2)))
    else:
        seconds = random.uniform(shortest / 2.0, longest / 2.0, size=(count, 2))
    seconds[::7, 1] = 0.0
    # Of one direction throughout, which is worst, or of another in each step.
    steady = unit(random, (count, 1, n)) * np.ones((1, 2 * STEPS, 1))
    phi = bound * np.where(random.random((count, 1, 1)) < 0.7, steady, unit(random, steady.shape))
    true = state
    many = rate.map(count)
    for step in range(2 * STEPS):
        part, dt = step // STEPS, seconds[:, step // STEPS] / STEPS

        def slope(at: Array, part: int = part, step: int = step) -> Array:
            return np.array(many(at.T, inputs[:, part].T)).T + phi[:, step]

        a = slope(true)
        b = slope(true + 0.5 * dt[:, None] * a)
        c = slope(true + 0.5 * dt[:, None] * b)
        d = slope(true + dt[:, None] * c)
        true = true + dt[:, None] * (a + 2.0 * b + 2.0 * c + d) / 6.0
    announced = inputs.copy()
    if false:
        other = (random.dirichlet(0.3 * np.ones(len(chosen)), size=count) @ chosen) - inputs[:, 1]
        announced[:, 1] += false * other
    off = error * unit(random, (2, count, n))
    return Windows(state + off[0], true + off[1], announced, seconds)
