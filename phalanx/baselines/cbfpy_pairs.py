"""The barriers of `cbfpy` in JAX, for single and double integrators and unicycles with spheres.

Obstacles are points at rest, so that agents of the same kind share one compiled filter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

from phalanx.theory.laws.law import ControlledAgent
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere

jax.config.update("jax_enable_x64", True)


@dataclass(frozen=True)
class Pairs:
    """All that a filter depends on."""

    own: Any
    """The agent's dynamics."""
    radii: tuple[float, ...]
    """Allowed distance from each other agent, then from each obstacle [m]."""
    gains: tuple[float, ...]
    """Of α_1 ... α_q."""

    @property
    def second(self) -> bool:
        """Return whether the inputs are accelerations."""
        return isinstance(self.own, DoubleIntegrator)

    @property
    def axes(self) -> int:
        """Return the dimensions of space."""
        return 2 if isinstance(self.own, Unicycle) else len(self.own.inputs)


def pairs_of(agent: ControlledAgent) -> Pairs:
    """Return the pairs of an agent. Raises ValueError if the agent does not fit."""
    spheres = [each for each in agent.static if isinstance(each, Sphere)]
    alphas = [each for each in agent.alpha if isinstance(each, Linear)]
    known = isinstance(agent.dynamics, SingleIntegrator | DoubleIntegrator | Unicycle)
    fits = known and len(spheres) == len(agent.static) and len(alphas) == len(agent.alpha)
    if not fits or not isinstance(agent.function, Separation):
        raise ValueError("cbfpy is for integrators and unicycles, 'separation' and spheres")
    radii = [agent.function.radius] * (len(agent.members) - 1)
    radii += [each.clearance for each in spheres]
    return Pairs(agent.dynamics, tuple(radii), tuple(each.gain for each in alphas))


@cache
def compiled(pairs: Pairs) -> Callable[[Any, Any], Any]:
    """Return (z, nominal input) -> input, compiled."""
    problem = Problem(pairs)
    found: Callable[[Any, Any], Any] = CBF.from_config(problem).safety_filter
    found(np.linspace(0.0, 1.0, problem.n), np.zeros(problem.m))
    return found


class Problem(CBFConfig):  # type: ignore[misc]
    """z is the agent's state, then the points of all others, then their velocities."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs, self.own, self.axes = pairs, pairs.own, pairs.axes
        self.states, self.count = len(self.own.states), len(pairs.radii)
        self.squares = jnp.array(pairs.radii) ** 2
        limit, n = self._limit(), self.states + 2 * self.count * self.axes
        super().__init__(n=n, m=len(limit), u_min=-limit, u_max=limit, relax_qp=True)

    def _limit(self) -> Any:
        if isinstance(self.own, Unicycle):
            return np.array([self.own.speed, self.own.turn_rate])
        largest = self.own.acceleration if self.pairs.second else self.own.speed
        return np.full(self.axes, largest)

    def f(self, z: Any) -> Any:
        """Others keep their velocity, and the agent has its drift."""
        own, moved = jnp.zeros(self.states), self.count * self.axes
        if self.pairs.second:
            v = z[self.axes : self.states]
            own = jnp.concatenate([v, -self.own.drag * v])
        return jnp.concatenate([own, z[self.states + moved :], jnp.zeros(moved)])

    def g(self, z: Any) -> Any:
        """The inputs move the agent alone."""
        g = jnp.zeros((self.n, self.m))
        if isinstance(self.own, Unicycle):
            column = jnp.array([jnp.cos(z[2]), jnp.sin(z[2])])
            return g.at[:2, 0].set(column).at[2, 1].set(1.0)
        first = self.axes if self.pairs.second else 0
        return g.at[first : first + self.axes].set(jnp.eye(self.axes))

    def h_1(self, z: Any) -> Any:
        """Squared distances less those allowed, if q = 1."""
        return jnp.zeros(0) if self.pairs.second else self._h(z)

    def h_2(self, z: Any) -> Any:
        """The same, if q = 2."""
        return self._h(z) if self.pairs.second else jnp.zeros(0)

    def alpha(self, h: Any) -> Any:
        """α_q of the scenario."""
        return self.pairs.gains[-1] * h

    def alpha_2(self, h_2: Any) -> Any:
        """α_1 of the scenario."""
        return self.pairs.gains[0] * h_2

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
        return jnp.sum((p - points) ** 2, axis=1) - self.squares
