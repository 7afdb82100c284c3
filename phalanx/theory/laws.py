"""Nominal laws of normal agents and attacks of adversaries: what each would like to apply.

Both return an input before it is made safe or projected onto U_i.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray

from phalanx.theory.compiled import CompiledFunction
from phalanx.theory.dynamics import Dynamics
from phalanx.theory.formation import Goal
from phalanx.theory.obstacles import Obstacle
from phalanx.theory.polytope import maximiser
from phalanx.theory.safe_set import Member
from phalanx.theory.terms import Terms

Array = NDArray[np.float64]
Gain = Annotated[float, Gt(0)]


class View(NamedTuple):
    """What a law may look at, at one sampling instant of agent i."""

    i: int
    x: Sequence[Array]
    """Every agent's state."""
    normal: Sequence[int]
    """Indices of the normal agents."""
    goal: Goal
    terms: Terms

    @property
    def positions(self) -> list[Array]:
        """Every agent's output position [m]."""
        return self.terms.positions


@runtime_checkable
class Law(Protocol):
    """A nominal law or an attack; a scenario names it ``package.module:Name``."""

    def prepare(self, dynamics: Dynamics) -> None:
        """Called once in the agent's process, before the first input.

        Raises ValueError if the law does not fit the dynamics.
        """

    def input(self, view: View) -> Array:
        """The wanted input, shape (m_i,)."""


@runtime_checkable
class TeamLaw(Protocol):
    """A law that must know the swarm before its first input."""

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> Law:
        """The law of agent i. Called once, after prepare. Raises ValueError if it does not fit."""


class OutputVelocity:
    """Inputs that give the output point a velocity: u = (J g)⁻¹ (v - J f), J = ∂p/∂x.

    For the unicycle this is the input-output linearisation below Eq. (IOoutputs).
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises ValueError unless the inputs act on the output's velocity, one for each axis."""
        x = ca.SX.sym("x", len(dynamics.states))
        p = dynamics.position(x)
        jacobian = ca.jacobian(p, x)
        decoupling = ca.sparsify(ca.simplify(jacobian @ dynamics.actuation(x)))
        if decoupling.shape[0] != decoupling.shape[1] or ca.sprank(decoupling) < p.numel():
            raise ValueError(
                f"{type(dynamics).__name__}: expected as many inputs as output axes, all acting "
                "on the output's velocity"
            )
        v = ca.SX.sym("v", p.numel())
        u = ca.solve(decoupling, v - jacobian @ dynamics.drift(x))
        self._evaluate = CompiledFunction([x, v], [u])

    def __call__(self, x: Array, velocity: Array) -> Array:
        """The input, shape (m,), for a state x, shape (n,), and a velocity [m/s]."""
        return self._evaluate(x, velocity)[0]


@dataclass
class TrackVelocity:
    """Output velocity v^d + k (p^d - p), the nominal law of Simulation 1."""

    gain: Gain = 1.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        self._invert = OutputVelocity(dynamics)

    def input(self, view: View) -> Array:
        error = view.goal.position - view.positions[view.i]
        return self._invert(view.x[view.i], view.goal.velocity + self.gain * error)


@dataclass
class Pursue:
    """Output velocity k (p_nearest - p): chase the nearest normal agent, as in Simulation 1."""

    gain: Gain = 5.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        self._invert = OutputVelocity(dynamics)

    def input(self, view: View) -> Array:
        here = view.positions[view.i]
        towards = [view.positions[n] - here for n in view.normal]
        nearest = min(towards, key=lambda d: float(d @ d))
        return self._invert(view.x[view.i], self.gain * nearest)


@dataclass
class WorstCase:
    """u_j^max of Eq. (adversarialu): the largest push on ψ_q that U_j allows."""

    def prepare(self, dynamics: Dynamics) -> None:
        """Fits every dynamics."""

    def input(self, view: View) -> Array:
        return maximiser(view.terms.c[view.i], view.terms.polytopes[view.i].corners)
