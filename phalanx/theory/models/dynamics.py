"""Control-affine dynamics x' = f(x) + g(x) u + φ with inputs in a polytope, Eq. (generalsystem)."""

from typing import Annotated, Any, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from annotated_types import Gt

from phalanx.arrays import Array
from phalanx.theory.expressions.asked import MistakenMethodError, ask

Positive = Annotated[float, Gt(0)]


@runtime_checkable
class Dynamics(Protocol):
    """What an agent's dynamics must say of itself. Expressions are CasADi; units are SI.

    A dataclass with these members is a dynamics; a scenario names it ``package.module:Name``.
    """

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the n states."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the m inputs."""

    def drift(self, x: ca.SX) -> ca.SX:
        """f(x), shape (n,)."""

    def actuation(self, x: ca.SX) -> ca.SX:
        """g(x), shape (n, m)."""

    def position(self, x: ca.SX) -> ca.SX:
        """The output point p(x) [m], shape (2,) or (3,): what pairs keep apart."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """A(x), shape (r, m), and b(x), shape (r,), with U(x) = {u : A(x) u <= b(x)} compact."""

    def input_metric(self) -> tuple[float, ...]:
        """Weights w, shape (m,): the QP minimises the sum of w (u - u_nom)²."""


@runtime_checkable
class Bounded(Protocol):
    """Dynamics that can say how far their output point gets, and so who cannot be near whom yet."""

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        """At most how far p gets from p(x) within `time` [m], whatever the inputs in U.

        Args:
            x: state, shape (n,).
            time: [s].
            disturbance: bound on the norm of φ.
        """


def travelled(dynamics: Bounded, x: Array, time: float, disturbance: float) -> float:
    """What a dynamics says of its travel. Raises MistakenMethodError if that is no distance."""
    found: Any = ask(dynamics, "travel", "a distance [m]", x, time, disturbance)
    if not isinstance(found, int | float) or not found >= 0.0:
        raise MistakenMethodError(dynamics, "travel", "a distance [m]", repr(found))
    return found


def box_polytope(bounds: tuple[float, ...]) -> tuple[ca.SX, ca.SX]:
    """The box |u_c| <= bounds_c as (A, b), shapes (2m, m) and (2m,)."""
    identity = np.eye(len(bounds))
    return ca.SX(np.vstack([identity, -identity])), ca.SX(np.array([*bounds, *bounds]))
