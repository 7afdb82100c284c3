"""Laws that track a goal or pursue an agent, by the output point and its derivatives.

Those of Simulation 1 command its velocity. Those of Simulation 2, for outputs of any degree q, are
u = K (x^d - x) + d^q/dt^q p^d, with K acting on the output and its derivatives; the signs are those
that attract (as printed in the paper they repel).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from annotated_types import MinLen

from phalanx.theory.arrays import Array
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

    def input_for(self, command: ca.SX) -> ca.SX:
        """u with G u = command, shape (m,); drift is not compensated, as in Simulation 2.

        Where G depends on the state it may be singular (a bicycle at standstill). A damped inverse
        then gives a large input, which is later projected onto U.
        """
        G = ca.densify(self.decoupling)
        if G.is_constant() and G.shape[0] == G.shape[1]:
            return ca.solve(G, command)
        return G.T @ ca.solve(G @ G.T + _DAMPING * ca.SX.eye(G.shape[0]), command)

    def pull(self, gains: Sequence[float], reference: Sequence[ca.SX]) -> ca.SX:
        """K (x^d - x), shape (d,); reference: p^d and its derivatives, 0 beyond the last."""
        rest = [ca.SX.zeros(*self.derivatives[0].shape)] * self.degree
        errors = zip(gains, [*reference, *rest], self.derivatives, strict=False)
        total = ca.SX.zeros(*self.derivatives[0].shape)
        for gain, there, here in errors:
            total += gain * (there - here)
        return total


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
        self.x, (self.p, self._drift, *more), self._G = output_chain(dynamics)
        G = self._G
        if more or G.shape[0] != G.shape[1] or ca.sprank(G) < self.p.numel():
            raise ValueError(
                f"{type(dynamics).__name__}: expected as many inputs as output axes, all acting "
                "on the output's velocity"
            )

    def input_for(self, velocity: ca.SX) -> ca.SX:
        """The input, shape (m,), an expression of the state x, for a velocity [m/s]."""
        return ca.solve(self._G, velocity - self._drift)


@dataclass
class TrackVelocity:
    """Output velocity v^d + k (p^d - p), the nominal law of Simulation 1.

    >>> law = TrackVelocity(gain=3.0)
    >>> law.prepare(SingleIntegrator(speed=1.0))
    >>> goal = Goal(np.ones(2), np.zeros(2), np.zeros(2))
    >>> law.input(View(0, {0: np.zeros(2)}, (0,), goal, None, t=0.0))
    array([3., 3.])
    """

    gain: Positive = 1.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        output = OutputVelocity(dynamics)
        p, v = (ca.SX.sym(name, output.p.numel()) for name in ("p", "v"))
        u = output.input_for(v + self.gain * (p - output.p))
        self.formula = CompiledFunction([output.x, p, v], [u])

    def input(self, view: View) -> Array:
        return self.formula(view.x[view.i], view.goal.position, view.goal.velocity)[0]


@dataclass
class Pursue:
    """Output velocity k (p_nearest - p): chase the nearest normal agent, as in Simulation 1.

    If it sees none it stays in place.

    >>> isinstance(Pursue(gain=2.0), Law)
    True
    """

    without_goal: ClassVar[bool] = True

    gain: Positive = 5.0
    """k [1/s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        output = OutputVelocity(dynamics)
        p = ca.SX.sym("p", output.p.numel())
        u = output.input_for(self.gain * (p - output.p))
        self.formula = CompiledFunction([output.x, p], [u])

    def input(self, view: View) -> Array:
        nearest = nearest_normal(view)
        target = view.i if nearest is None else nearest
        return self.formula(view.x[view.i], view.positions[target])[0]


def nearest_normal(view: View) -> int | None:
    """The nearest normal agent in sight; None if there is none."""
    if not view.normal:
        return None
    positions = view.positions
    towards = np.array([positions[n] for n in view.normal]) - positions[view.i]
    return view.normal[int(dot(towards, towards).argmin())]


Gains = Annotated[tuple[Positive, ...], MinLen(1)]


def tracked_chain(dynamics: Dynamics, gains: Gains) -> OutputChain:
    """The output's chain. Raises ValueError unless there is a gain for each derivative."""
    chain = output_chain(dynamics)
    if len(gains) != chain.degree:
        raise ValueError(
            f"gains: {type(dynamics).__name__} needs {chain.degree}, one for the output and each "
            f"of its derivatives below the input; got {len(gains)}"
        )
    return chain


@dataclass
class Track:
    """K (x^d - x) + the q-th derivative of p^d: the nominal law of Simulation 2.

    >>> law = Track(gains=(2.0,))
    >>> law.prepare(SingleIntegrator(speed=1.0))
    >>> goal = Goal(np.ones(2), np.zeros(2), np.zeros(2))
    >>> law.input(View(0, {0: np.zeros(2)}, (0,), goal, None, t=0.0))
    array([2., 2.])
    """

    gains: Gains
    """k_1 ... k_q of the position error and its derivatives' [1/s^q ... 1/s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        chain = tracked_chain(dynamics, self.gains)
        q, axes = chain.degree, chain.derivatives[0].numel()
        goal = [ca.SX.sym(name, axes) for name in ("p", "v", "a")]
        command = chain.pull(self.gains, goal)
        if q < len(goal):
            command += goal[q]
        self.formula = CompiledFunction([chain.x, *goal], [chain.input_for(command)])

    def input(self, view: View) -> Array:
        goal = view.goal
        return self.formula(view.x[view.i], goal.position, goal.velocity, goal.acceleration)[0]
