"""The same model for JAX: one seed's run as a scan, compiled, and mapped over seeds."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
from typing import Any

import batched_numpy as m
import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)


def composed(p: Any) -> Any:
    """Return h_tot."""
    off, to_obstacle = p[m.FIRST] - p[m.SECOND], p[:3, None] - m.OBSTACLES
    obstacles = (m.CLEARANCE**2 - (to_obstacle**2).sum(-1)).ravel()
    h = jnp.concatenate([m.RADIUS**2 - (off**2).sum(-1), obstacles])
    return jax.nn.logsumexp(m.RHO * h) / m.RHO


def controls(x: Any, last_input: Any, t: Any) -> tuple[Any, Any]:
    """Return the inputs of all agents, (5, 2), and h_tot; last_input: the last inputs."""
    forward = jnp.stack([jnp.cos(x[:, 2]), jnp.sin(x[:, 2])], -1)
    p = x[:, :2] + m.OFFSET * forward
    across = jnp.stack([-forward[:, 1], forward[:, 0]], -1)
    h_tot, slope = jax.value_and_grad(composed)(p)
    center, velocity = m.bezier(jnp, t)
    near = ((p[3:, None] - p[None, :3]) ** 2).sum(-1).argmin(-1)
    wish = jnp.concatenate([velocity + center + m.PLACES[:3] - p[:3], 5.0 * (p[near] - p[3:])])
    nominal = jnp.stack([(wish * forward).sum(-1), (wish * across).sum(-1) / m.OFFSET], -1)
    c = jnp.stack([(slope * forward).sum(-1), m.OFFSET * (slope * across).sum(-1)], -1)
    last_rate = (c[:3] * last_input[:3]).sum(-1)
    bound = (
        -m.ALPHA * h_tot
        - m.ETA
        - (jnp.abs(c[3:]) * m.LIMIT[3:]).sum()
        - last_rate.sum()
        + last_rate
    )

    def input_at(multiplier: Any) -> Any:
        return jnp.clip(nominal[:3] - multiplier[:, None] * c[:3], -m.LIMIT[:3], m.LIMIT[:3])

    def halve(_: Any, ends: Any) -> Any:
        low, high = ends
        middle = 0.5 * (low + high)
        above = (c[:3] * input_at(middle)).sum(-1) > bound
        return jnp.where(above, middle, low), jnp.where(above, high, middle)

    _, high = jax.lax.fori_loop(0, 50, halve, (jnp.zeros(3), jnp.full(3, 1e6)))
    return jnp.concatenate(
        [input_at(high), jnp.clip(nominal[3:], -m.LIMIT[3:], m.LIMIT[3:])]
    ), h_tot


def run(start: Any, knots: Any) -> Any:
    """Return the largest h_tot of a seed."""

    def sample(carry: Any, k: Any) -> Any:
        x, u, largest = carry
        t = k * m.PERIOD
        n = jnp.floor(t / m.EVERY).astype(int)
        phi = knots[n] + (t / m.EVERY - n) * (knots[n + 1] - knots[n])
        u, h_tot = controls(x, u, t)
        x = jax.lax.fori_loop(0, m.STEPS, lambda _, x: m.stepped(jnp, x, u, phi), x)
        return (x, u, jnp.maximum(largest, h_tot)), None

    first = start, jnp.zeros((5, 2)), -jnp.inf
    return jax.lax.scan(sample, first, jnp.arange(round(m.DURATION / m.PERIOD)))[0][2]


simulate = jax.jit(jax.vmap(run))
