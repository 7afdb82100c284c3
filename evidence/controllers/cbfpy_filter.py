"""A filter by the library cbfpy: a barrier for each pair, as in continuous time, in JAX.

    pip install -e '.[bench]'

As a user of cbfpy would write it: others go on with the velocity that is seen, none is assumed to
attack or to help, and nothing is known of sampling. For single and double integrators and unicycles
with spheres.
"""

import os

# As cbfpy recommends; they count only before JAX is imported.
os.environ |= {"JAX_ENABLE_X64": "1", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

from phalanx.extend import (
    Array,
    ControlledAgent,
    ControllerView,
    DoubleIntegrator,
    Linear,
    Separation,
    SingleIntegrator,
    Sphere,
    Unicycle,
)

_FAR = 1e3
"""Place of agents that are not seen [m]."""


@dataclass
class CbfPy:
    """cbfpy's safety filter, with slack: without a solution it violates least."""

    def prepare(self, agent: ControlledAgent) -> None:
        self.problem = Problem(agent)
        self.filter = CBF.from_config(self.problem)
        self.before: dict[int, Array] = {}
        self.t = 0.0

    def input(self, view: ControllerView) -> Array:
        problem, elapsed = self.problem, view.t - self.t
        points = np.full((len(problem.others), problem.axes), _FAR)
        speeds = np.zeros_like(points)
        for k, l in enumerate(problem.others):
            if l not in view.x:
                continue
            points[k] = view.positions[l]
            if problem.second:
                speeds[k] = view.x[l][problem.axes :]
            elif elapsed > 0.0:
                speeds[k] = (points[k] - self.before.get(l, points[k])) / elapsed
        self.before, self.t = dict(view.positions), view.t
        z = np.concatenate([view.x[view.i], points.ravel(), speeds.ravel()])
        u: Array = np.array(self.filter.safety_filter(z, view.nearest(view.u_nom)))
        return u


class Problem(CBFConfig):  # type: ignore[misc]
    """z is the agent's state, then the others' positions, then their velocities."""

    def __init__(self, agent: ControlledAgent) -> None:
        self.own: Any = agent.dynamics
        spheres = [each for each in agent.static if isinstance(each, Sphere)]
        alphas = [each for each in agent.alpha if isinstance(each, Linear)]
        known = isinstance(self.own, SingleIntegrator | DoubleIntegrator | Unicycle)
        fits = known and len(spheres) == len(agent.static) and len(alphas) == len(agent.alpha)
        if not fits or not isinstance(agent.function, Separation):
            raise ValueError("cbfpy_filter is for integrators and unicycles with spheres")
        self.second = isinstance(self.own, DoubleIntegrator)
        self.axes = 2 if isinstance(self.own, Unicycle) else len(self.own.inputs)
        self.others = [l for l in range(len(agent.members)) if l != agent.i]
        self.count, self.states = len(self.others), len(self.own.states)
        self.centers = jnp.array([each.center for each in spheres]).reshape(-1, self.axes)
        radii = [agent.function.radius] * self.count + [each.clearance for each in spheres]
        self.squares, self.gains = jnp.array(radii) ** 2, [each.gain for each in alphas]
        limit = self._limit()
        n = self.states + 2 * self.count * self.axes
        super().__init__(n=n, m=len(limit), u_min=-limit, u_max=limit, relax_qp=True)

    def _limit(self) -> Array:
        if isinstance(self.own, Unicycle):
            return np.array([self.own.speed, self.own.turn_rate])
        largest = self.own.acceleration if self.second else self.own.speed
        return np.full(self.axes, largest)

    def f(self, z: Any) -> Any:
        """Others keep their velocity, and the agent has its drift."""
        own, moved = z[: self.states], self.count * self.axes
        if self.second:
            v = own[self.axes :]
            own = jnp.concatenate([v, -self.own.drag * v])
        else:
            own = jnp.zeros(self.states)
        return jnp.concatenate([own, z[self.states + moved :], jnp.zeros(moved)])

    def g(self, z: Any) -> Any:
        """The inputs move the agent alone."""
        g = jnp.zeros((self.n, self.m))
        if isinstance(self.own, Unicycle):
            column = jnp.array([jnp.cos(z[2]), jnp.sin(z[2])])
            return g.at[:2, 0].set(column).at[2, 1].set(1.0)
        first = self.axes if self.second else 0
        return g.at[first : first + self.axes].set(jnp.eye(self.axes))

    def h_1(self, z: Any) -> Any:
        """Squared distances less those allowed, if q = 1."""
        return jnp.zeros(0) if self.second else self._h(z)

    def h_2(self, z: Any) -> Any:
        """The same, if q = 2."""
        return self._h(z) if self.second else jnp.zeros(0)

    def alpha(self, h: Any) -> Any:
        """α_q of the scenario."""
        return self.gains[-1] * h

    def alpha_2(self, h_2: Any) -> Any:
        """α_1 of the scenario."""
        return self.gains[0] * h_2

    def P(self, z: Any, u_des: Any) -> Any:  # noqa: N802
        """The scenario's metric of inputs."""
        return jnp.diag(2.0 * jnp.array(self.own.input_metric()))

    def q(self, z: Any, u_des: Any) -> Any:
        """The same metric, towards the nominal input."""
        return -2.0 * jnp.array(self.own.input_metric()) * u_des

    def _h(self, z: Any) -> Any:
        p = z[: self.axes]
        if isinstance(self.own, Unicycle):
            p = p + self.own.offset * jnp.array([jnp.cos(z[2]), jnp.sin(z[2])])
        points = z[self.states : self.states + self.count * self.axes].reshape(-1, self.axes)
        each = jnp.concatenate([points, self.centers])
        return jnp.sum((p - each) ** 2, axis=1) - self.squares
