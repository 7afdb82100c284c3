"""Laws that track a goal or pursue an agent, by the output point and its derivatives.

Those of Simulation 1 command its velocity. Those of Simulation 2, for outputs of any degree q, are
u = K (x^d - x) + d^q/dt^q p^d, with K acting on the output and its derivatives; the signs are those
that attract (as printed in the paper they repel).
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import casadi as ca
import numpy as np
from annotated_types import MinLen

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics, Positive

_MOST = 4
_DAMPING = 1e-9


class OutputChain(NamedTuple):
    """Derivatives of an output point p along the dynamics, up to that on which inputs act."""

    x: ca.SX
    """The state, symbols, shape (n,)."""
    derivatives: list[ca.SX]
    """p, p', ..., p^(q), the last without the inputs' part, shapes (d,)."""
    decoupling: ca.SX
    """G, with p^(q) = derivatives[q] + G u, shape (d, m)."""

    @property
    def degree(self) -> int:
        """q of the output."""
        return len(self.derivatives) - 1


def output_chain(dynamics: Dynamics) -> OutputChain:
    """Differentiate p. Raises ValueError if no input acts on its first derivatives."""
    x = ca.SX.sym("x", len(dynamics.states))
    f, g = dynamics.drift(x), dynamics.actuation(x)
    derivatives = [dynamics.position(x)]
    for _ in range(_MOST):
        jacobian = ca.jacobian(derivatives[-1], x)
        decoupling = ca.sparsify(ca.simplify(jacobian @ g))
        derivatives.append(jacobian @ f)
        if decoupling.nnz() > 0:
            return OutputChain(x, derivatives, decoupling)
    name = type(dynamics).__name__
    raise ValueError(f"{name}: no input acts on the first {_MOST} derivatives of p")


class OutputVelocity:
    """Inputs that give the output point a velocity: u = (J g)⁻¹ (v - J f), J = ∂p/∂x.

    For the unicycle this is the input-output linearisation below Eq. (IOoutputs).
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises ValueError unless the inputs act on the output's velocity, one for each axis."""
        x, (p, drift, *more), G = output_chain(dynamics)
        if more or G.shape[0] != G.shape[1] or ca.sprank(G) < p.numel():
            raise ValueError(
                f"{type(dynamics).__name__}: expected as many inputs as output axes, all acting "
                "on the output's velocity"
            )
        v = ca.SX.sym("v", p.numel())
        self._evaluate = CompiledFunction([x, v], [ca.solve(G, v - drift)])

    def __call__(self, x: Array, velocity: Array) -> Array:
        """The input, shape (m,), for a state x, shape (n,), and a velocity [m/s]."""
        return self._evaluate(x, velocity)[0]


@dataclass
class TrackVelocity:
    """Output velocity v^d + k (p^d - p), the nominal law of Simulation 1."""

    gain: Positive = 1.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        self._invert = OutputVelocity(dynamics)

    def input(self, view: View) -> Array:
        error = view.goal.position - view.positions[view.i]
        return self._invert(view.x[view.i], view.goal.velocity + self.gain * error)


@dataclass
class Pursue:
    """Output velocity k (p_nearest - p): chase the nearest normal agent, as in Simulation 1.

    If it sees none it stays in place.
    """

    gain: Positive = 5.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        self._invert = OutputVelocity(dynamics)

    def input(self, view: View) -> Array:
        nearest = nearest_normal(view)
        target = view.i if nearest is None else nearest
        towards = view.positions[target] - view.positions[view.i]
        return self._invert(view.x[view.i], self.gain * towards)


def nearest_normal(view: View) -> int | None:
    """The nearest normal agent in sight; None if there is none."""
    towards = {n: view.positions[n] - view.positions[view.i] for n in view.normal}
    return min(towards, key=lambda n: float(dot(towards[n], towards[n])), default=None)


class OutputDerivatives:
    """p, p', ..., p^(q-1) of one dynamics, and the inverse of its decoupling matrix G.

    Where G depends on the state it may be singular (a bicycle at standstill). A damped inverse then
    gives a large input, which is later projected onto U.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises ValueError if no input acts on the first derivatives of the output."""
        chain = output_chain(dynamics)
        self.degree = chain.degree
        """q of the output."""
        wanted = ca.SX.sym("wanted", chain.derivatives[0].numel())
        self._invert = CompiledFunction([chain.x, wanted], [_solve(chain.decoupling, wanted)])
        self._evaluate = CompiledFunction([chain.x], [ca.horzcat(*chain.derivatives[:-1]).T])

    def __call__(self, x: Array) -> Array:
        """p, p', ..., p^(q-1) without inputs, shape (q, d), at a state x, shape (n,)."""
        return self._evaluate(x)[0].reshape(self.degree, -1)

    def input_for(self, x: Array, wanted: Array) -> Array:
        """u with G(x) u = wanted, shape (m,); drift is not compensated, as in Simulation 2."""
        return self._invert(x, wanted)[0]


def _solve(G: ca.SX, wanted: ca.SX) -> ca.SX:
    if G.is_constant() and G.shape[0] == G.shape[1]:
        return ca.solve(ca.densify(G), wanted)
    dense = ca.densify(G)
    return dense.T @ ca.solve(dense @ dense.T + _DAMPING * ca.SX.eye(G.shape[0]), wanted)


Gains = Annotated[tuple[Positive, ...], MinLen(1)]


def output_derivatives(dynamics: Dynamics, gains: Gains) -> OutputDerivatives:
    output = OutputDerivatives(dynamics)
    if len(gains) != output.degree:
        raise ValueError(
            f"gains: {type(dynamics).__name__} needs {output.degree}, one for the output and each "
            f"of its derivatives below the input; got {len(gains)}"
        )
    return output


@dataclass
class Track:
    """K (x^d - x) + the q-th derivative of p^d: the nominal law of Simulation 2."""

    gains: Gains
    """k_1 ... k_q of the position error and its derivatives' [1/s^q ... 1/s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        self._output = output_derivatives(dynamics, self.gains)

    def input(self, view: View) -> Array:
        x = view.x[view.i]
        q, d = self._output.degree, len(view.goal.position)
        goal = np.zeros((q + 1, d))
        goal[: len(view.goal)] = view.goal[: q + 1]
        error = goal[:q] - self._output(x)
        return self._output.input_for(x, dot(error.T, np.array(self.gains)) + goal[q])
