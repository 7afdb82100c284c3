"""Laws that command the output point's velocity: track a goal, pursue an agent."""

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Gt

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics

Gain = Annotated[float, Gt(0)]


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
    """Output velocity k (p_nearest - p): chase the nearest normal agent, as in Simulation 1.

    With none in sight it holds its place.
    """

    gain: Gain = 5.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        self._invert = OutputVelocity(dynamics)

    def input(self, view: View) -> Array:
        here = view.positions[view.i]
        towards = [view.positions[n] - here for n in view.normal]
        nearest = min(towards, key=lambda d: float(dot(d, d)), default=np.zeros_like(here))
        return self._invert(view.x[view.i], self.gain * nearest)
