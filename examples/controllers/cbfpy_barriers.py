"""A controller: a barrier for each pair, as in continuous time, by the library cbfpy in JAX.

pip install cbfpy; in this folder:
phalanx run unicycles --set agents.0.controller.type=cbfpy_barriers:CbfPy --set time.timeout=60

As a user of cbfpy would write it: others go on with the velocity that is seen, none is assumed to
attack or to help, and nothing is known of sampling. Obstacles are points at rest, so that agents of
the same kind share one filter, which takes seconds to compile. JAX does not give the same bits on
every CPU.
"""

import warnings
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

from phalanx.extend import (
    DoubleIntegrator,
    Dynamics,
    Linear,
    Separation,
    SingleIntegrator,
    Sphere,
    Unicycle,
)

jax.config.update("jax_enable_x64", True)
FAR = 1e3
"""Coordinate of agents that are not seen [m]."""


@dataclass
class CbfPy:
    """cbfpy's safety filter, with slack: without a solution it violates least."""

    def prepare(self, agent):
        """Compile the filter. Raises ValueError if the agent does not fit."""
        pairs = pairs_of(agent)
        with warnings.catch_warnings(action="ignore"):  # of settings, and of h at a trial state
            self.filter = compiled(pairs)
        self.axes, self.second = pairs.axes, pairs.second
        self.others = [l for l in range(len(agent.members)) if l != agent.i]
        self.static = [each.center for each in agent.static]
        self.before, self.t = {}, 0.0

    def input(self, view):
        """Return the input of cbfpy's QP."""
        points = np.full((len(self.others) + len(self.static), self.axes), FAR)
        points[len(self.others) :] = self.static or points[:0]
        speeds = np.zeros_like(points)
        for k, l in enumerate(self.others):
            if l in view.x:
                points[k], speeds[k] = view.positions[l], self.velocity(view, l)
        self.before, self.t = dict(view.positions), view.t
        z = np.concatenate([view.x[view.i], points.ravel(), speeds.ravel()])
        return np.array(self.filter(z, view.nearest(view.u_nom)))

    def velocity(self, view, l):
        """Return another's velocity, sampled, or from its last two positions [m/s]."""
        if self.second:
            return view.x[l][self.axes :]
        elapsed, here = view.t - self.t, view.positions[l]
        return (here - self.before.get(l, here)) / elapsed if elapsed > 0.0 else 0.0 * here


class Pairs(NamedTuple):
    """All that a filter depends on."""

    dynamics: Dynamics
    """The agent's."""
    radii: tuple[float, ...]
    """Allowed distance from each other agent, then from each obstacle [m]."""
    gains: tuple[float, ...]
    """Of α_1 ... α_q."""

    @property
    def second(self):
        """True if the inputs are accelerations."""
        return isinstance(self.dynamics, DoubleIntegrator)

    @property
    def axes(self):
        """The dimensions of space."""
        return 2 if isinstance(self.dynamics, Unicycle) else len(self.dynamics.inputs)


def pairs_of(agent):
    """Return the pairs of an agent. Raises ValueError if the agent does not fit."""
    fits = (
        isinstance(agent.dynamics, SingleIntegrator | DoubleIntegrator | Unicycle)
        and isinstance(agent.function, Separation)
        and all(isinstance(each, Sphere) for each in agent.static)
        and all(isinstance(each, Linear) for each in agent.alpha)
    )
    if not fits:
        raise ValueError("cbfpy is for integrators and unicycles, 'separation' and spheres")
    radii = [agent.function.radius] * (len(agent.members) - 1)
    radii += [each.clearance for each in agent.static]
    return Pairs(agent.dynamics, tuple(radii), tuple(each.gain for each in agent.alpha))


@cache
def compiled(pairs):
    """Return (z, nominal input) -> input, compiled."""
    problem = Problem(pairs)
    safety_filter = CBF.from_config(problem).safety_filter
    safety_filter(np.linspace(0.0, 1.0, problem.n), np.zeros(problem.m))
    return safety_filter


class Problem(CBFConfig):
    """z is the agent's state, then the points of all others, then their velocities."""

    def __init__(self, pairs):
        self.pairs, self.dynamics, self.axes = pairs, pairs.dynamics, pairs.axes
        self.states, self.count = len(self.dynamics.states), len(pairs.radii)
        self.squares = jnp.array(pairs.radii) ** 2
        limit, n = self.largest(), self.states + 2 * self.count * self.axes
        super().__init__(n=n, m=len(limit), u_min=-limit, u_max=limit, relax_qp=True)

    def largest(self):
        """Return the largest inputs."""
        if isinstance(self.dynamics, Unicycle):
            return np.array([self.dynamics.speed, self.dynamics.turn_rate])
        largest = self.dynamics.acceleration if self.pairs.second else self.dynamics.speed
        return np.full(self.axes, largest)

    def f(self, z):
        """Others keep their velocity, and the agent has its drift."""
        drift, moved = jnp.zeros(self.states), self.count * self.axes
        if self.pairs.second:
            v = z[self.axes : self.states]
            drift = jnp.concatenate([v, -self.dynamics.drag * v])
        return jnp.concatenate([drift, z[self.states + moved :], jnp.zeros(moved)])

    def g(self, z):
        """The inputs move the agent alone."""
        g = jnp.zeros((self.n, self.m))
        if isinstance(self.dynamics, Unicycle):
            column = jnp.array([jnp.cos(z[2]), jnp.sin(z[2])])
            return g.at[:2, 0].set(column).at[2, 1].set(1.0)
        first = self.axes if self.pairs.second else 0
        return g.at[first : first + self.axes].set(jnp.eye(self.axes))

    def h_1(self, z):
        """The barriers, if q = 1."""
        return jnp.zeros(0) if self.pairs.second else self.barriers(z)

    def h_2(self, z):
        """The same, if q = 2."""
        return self.barriers(z) if self.pairs.second else jnp.zeros(0)

    def alpha(self, h):
        """α_q of the scenario."""
        return self.pairs.gains[-1] * h

    def alpha_2(self, h_2):
        """α_1 of the scenario."""
        return self.pairs.gains[0] * h_2

    def P(self, z, u_des):  # noqa: N802
        """The scenario's metric of inputs."""
        return jnp.diag(2.0 * jnp.array(self.dynamics.input_metric()))

    def q(self, z, u_des):
        """The same metric, towards the nominal input."""
        return -2.0 * jnp.array(self.dynamics.input_metric()) * u_des

    def barriers(self, z):
        """Return squared distances less those allowed."""
        p = z[: self.axes]
        if isinstance(self.dynamics, Unicycle):
            p = p + self.dynamics.offset * jnp.array([jnp.cos(z[2]), jnp.sin(z[2])])
        points = z[self.states : self.states + self.count * self.axes].reshape(-1, self.axes)
        return jnp.sum((p - points) ** 2, axis=1) - self.squares
