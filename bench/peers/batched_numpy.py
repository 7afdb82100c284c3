"""Simulation 1 in numpy, for many seeds at once: the peer's model, without network or proof.

Five unicycles sample at the same instants, each knows all states and the last inputs of normal
agents, and the row of h_tot is met exactly by bisection over its multiplier.
"""

from typing import Any

import numpy as np

from phalanx.theory.arrays import Array

PERIOD, STEPS, DURATION, EVERY = 0.01, 10, 24.0, 0.2
"""Of samples, integration steps in one, of the run, and of knots of the disturbance [s]."""
RHO, ALPHA, ETA, RADIUS, OFFSET, BOUND = 5.0, 2.0, 8.0566, 1.0, 0.25, 1.73
LIMIT = np.array([[4.0, 2.0]] * 3 + [[2.0, 1.0]] * 2)
GAIN = np.array([1.0, 1.0, 1.0, 5.0, 5.0])
OBSTACLES = np.array([[14.0, 9.0], [26.0, -9.0], [34.0, 4.0]])
CLEARANCE = 1.25
PATH = np.array([[0.0, 0.0], [16.0, 12.0], [24.0, -12.0], [40.0, 0.0]])
SLOTS = 2.0 * np.pi * np.array([0, 1, 4, 2, 3]) / 5.0
PLACES = 4.0 * np.column_stack([np.cos(SLOTS), np.sin(SLOTS)])
FIRST, SECOND = np.array([(a, b) for a in range(3) for b in range(a + 1, 5)]).T


def draws(seeds: int) -> tuple[Array, Array]:
    """Return starts, (seeds, 5, 3), and knots of the disturbance, (seeds, knots, 5, 3)."""
    rng = np.random.default_rng(0)
    spread = rng.uniform(-1.0, 1.0, (seeds, 5, 3)) * [0.2, 0.2, 0.3]
    start = np.column_stack([PLACES + PATH[0], np.zeros(5)]) + spread
    knots = rng.uniform(-1.0, 1.0, (seeds, round(DURATION / EVERY) + 2, 5, 3))
    return start, BOUND / np.sqrt(3.0) * knots


def bezier(xp: Any, t: Any) -> tuple[Any, Any]:
    """Return the formation's centre and its velocity; xp: numpy, or JAX's."""
    s = t / DURATION
    b = xp.array([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s * s * (1 - s), s**3])
    d = xp.array([(1 - s) ** 2, 2 * s * (1 - s), s * s])
    return b @ PATH, 3.0 * d @ (PATH[1:] - PATH[:-1]) / DURATION


def stepped(xp: Any, x: Any, u: Any, phi: Any) -> Any:
    """Return the states after a Runge-Kutta step, (..., 5, 3)."""

    def rate(x: Any) -> Any:
        v, w = u[..., 0], u[..., 1]
        return xp.stack([v * xp.cos(x[..., 2]), v * xp.sin(x[..., 2]), w], -1) + phi

    dt, a = PERIOD / STEPS, rate(x)
    b = rate(x + dt / 2 * a)
    c = rate(x + dt / 2 * b)
    return x + dt / 6 * (a + 2 * b + 2 * c + rate(x + dt * c))


def controls(x: Array, last_input: Array, t: float) -> tuple[Array, Array]:
    """Return the inputs of all agents, (seeds, 5, 2), and h_tot; last_input: the last inputs."""
    cos, sin = np.cos(x[..., 2]), np.sin(x[..., 2])
    p = x[..., :2] + OFFSET * np.stack([cos, sin], -1)
    off, to_obstacle = p[:, FIRST] - p[:, SECOND], p[:, :3, None] - OBSTACLES
    obstacles = (CLEARANCE**2 - (to_obstacle**2).sum(-1)).reshape(len(x), -1)
    h = np.concatenate([RADIUS**2 - (off**2).sum(-1), obstacles], 1)
    peak = h.max(1)
    weight = np.exp(RHO * (h - peak[:, None]))
    total = weight.sum(1)
    weight, h_tot = weight / total[:, None], peak + np.log(total) / RHO
    pairs = -2.0 * weight[:, : len(FIRST), None] * off
    slope: Array = np.einsum("pa,spd->sad", np.eye(5)[FIRST] - np.eye(5)[SECOND], pairs)
    around = weight[:, len(FIRST) :].reshape(len(x), 3, -1)
    slope[:, :3] -= 2.0 * (around[..., None] * to_obstacle).sum(2)
    center, velocity = bezier(np, t)
    near = ((p[:, 3:, None] - p[:, None, :3]) ** 2).sum(-1).argmin(-1)
    prey = np.take_along_axis(p[:, :3], near[..., None], 1)
    wish = np.concatenate([velocity + center + PLACES[:3] - p[:, :3], 5.0 * (prey - p[:, 3:])], 1)
    across, forward = np.stack([-sin, cos], -1), np.stack([cos, sin], -1)
    nominal = np.stack([(wish * forward).sum(-1), (wish * across).sum(-1) / OFFSET], -1)
    c = np.stack([(slope * forward).sum(-1), OFFSET * (slope * across).sum(-1)], -1)
    worst = (np.abs(c[:, 3:]) * LIMIT[3:]).sum((1, 2))
    last_rate = (c[:, :3] * last_input[:, :3]).sum(-1)
    bound = (-ALPHA * h_tot - ETA - worst - last_rate.sum(1))[:, None] + last_rate
    low, high = np.zeros_like(bound), np.full_like(bound, 1e6)
    for _ in range(50):
        middle = 0.5 * (low + high)
        u = np.clip(nominal[:, :3] - middle[..., None] * c[:, :3], -LIMIT[:3], LIMIT[:3])
        above = (c[:, :3] * u).sum(-1) > bound
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    u = np.clip(nominal, -LIMIT, LIMIT)
    u[:, :3] = np.clip(nominal[:, :3] - high[..., None] * c[:, :3], -LIMIT[:3], LIMIT[:3])
    return u, h_tot


def simulate(start: Array, knots: Array) -> Array:
    """Return the largest h_tot of each seed, (seeds,)."""
    x, u = start, np.zeros((len(start), 5, 2))
    largest = np.full(len(start), -np.inf)
    for k in range(round(DURATION / PERIOD)):
        t = k * PERIOD
        n, share = divmod(t / EVERY, 1.0)
        phi = knots[:, int(n)] + share * (knots[:, int(n) + 1] - knots[:, int(n)])
        u, h_tot = controls(x, u, t)
        largest = np.maximum(largest, h_tot)
        for _ in range(STEPS):
            x = stepped(np, x, u, phi)
    return largest
