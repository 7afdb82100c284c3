"""Control-affine dynamics x' = f(x) + g(x) u + φ with inputs in a polytope, Eq. (generalsystem).

Also the check of a user's dynamics (names, shapes and weights), and their integration.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from annotated_types import Gt

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.user_methods import (
    MistakenMethodError,
    Shape,
    check_of,
    require_expression,
)
from phalanx.theory.models.polytope import EmptyPolytopeError, constant_polytope

Positive = Annotated[float, Gt(0)]
"""A field that has to be above 0."""


@runtime_checkable
class Dynamics(Protocol):
    """The dynamics of an agent. Expressions are CasADi's; units are SI.

    A dataclass with these members is a dynamics; a scenario names it ``package.module:Name``.

    >>> class Slider:
    ...     states, inputs = ("x", "y"), ("vx",)
    ...     def drift(self, x):
    ...         return ca.SX.zeros(2)
    ...     def actuation(self, x):
    ...         return ca.SX([1, 0])
    ...     def position(self, x):
    ...         return x
    ...     def input_polytope(self, x):
    ...         return box_polytope((1.0,))
    ...     def input_metric(self):
    ...         return (1.0,)
    >>> isinstance(Slider(), Dynamics)
    True
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
        """The output point p(x) [m], shape (2,) or (3,), from which distances are measured."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """A(x), shape (r, m), and b(x), shape (r,), with U(x) = {u : A(x) u <= b(x)} compact."""

    def input_metric(self) -> tuple[float, ...]:
        """Weights w, shape (m,): the QP minimises the sum of w (u - u_nom)²."""


@runtime_checkable
class Bounded(Protocol):
    """Dynamics with a bound on how far the output point can move in a given time.

    >>> round(SingleIntegrator(speed=1.0).travel(np.zeros(2), 2.0, disturbance=0.5), 2)
    3.83
    """

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        """Bound the distance of p from p(x) within `time` [m], for any inputs in U.

        Args:
            x: state, shape (n,).
            time: [s].
            disturbance: bound on the norm of φ.
        """


@check_of(Dynamics, "travel")
def _distance(dynamics: Bounded, distance: Any, *_: object) -> float:
    if not isinstance(distance, int | float) or not distance >= 0.0:
        raise MistakenMethodError(dynamics, "travel", "a distance [m]", repr(distance))
    return distance


def box_polytope(bounds: tuple[float, ...]) -> tuple[ca.SX, ca.SX]:
    """The box |u_c| <= bounds_c as (A, b), shapes (2m, m) and (2m,).

    >>> A, b = box_polytope((2.0, 1.0))
    >>> ca.DM(b)
    DM([2, 1, 2, 1])
    """
    identity = np.eye(len(bounds))
    return ca.SX(np.vstack([identity, -identity])), ca.SX(np.array([*bounds, *bounds]))


@runtime_checkable
class Measured(Protocol):
    """Dynamics with units; a dataclass may have them as plain attributes.

    >>> Unicycle(speed=1.0, turn_rate=2.0).state_units
    ('m', 'm', 'rad')
    """

    @property
    def state_units(self) -> tuple[str, ...]:
        """The unit of each state, such as "m" or "rad"."""

    @property
    def input_units(self) -> tuple[str, ...]:
        """The unit of each input, such as "m/s²"."""


class Units(NamedTuple):
    """Units by name; "" for dynamics without units."""

    states: dict[str, str]
    inputs: dict[str, str]


def units(dynamics: Dynamics) -> Units:
    """The units of a dynamics' states and inputs."""
    if not isinstance(dynamics, Measured):
        return Units(dict.fromkeys(dynamics.states, ""), dict.fromkeys(dynamics.inputs, ""))
    return Units(
        dict(zip(dynamics.states, dynamics.state_units, strict=True)),
        dict(zip(dynamics.inputs, dynamics.input_units, strict=True)),
    )


def angles(dynamics: Dynamics) -> set[str]:
    """Names of the states that are angles: those in rad, and the heading."""
    states, turns = enumerate(units(dynamics).states.items()), heading(dynamics)
    return {name for k, (name, unit) in states if unit == "rad" or k == turns}


def heading(dynamics: Dynamics) -> int | None:
    """Index of the state that turns the output point's velocity about z; None without one."""
    x, u = (ca.SX.sym("s", len(names)) for names in (dynamics.states, dynamics.inputs))
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    velocity = (ca.jacobian(dynamics.position(x), x) @ rate)[:2]
    # By an angle, the derivative of a turned vector is that vector, a quarter turn ahead.
    off = ca.jacobian(velocity, x) - ca.vertcat(-velocity[1], velocity[0])
    # At numbers without a pattern, that is so for the heading alone.
    some = [np.linspace(0.3, 0.7, values.numel()) for values in (x, u)]
    columns = ca.Function("off", [x, u], [off])(*some).full().T
    return next((k for k, column in enumerate(columns) if np.allclose(column, 0.0)), None)


def require_sound(dynamics: Dynamics) -> None:
    """Call all methods of a dynamics and check their results.

    Raises:
        MistakenMethodError: a shape or a name is wrong, a weight is not above 0, or it failed.
    """
    n, m = (_count(dynamics, field) for field in ("states", "inputs"))
    for field, count in (("state_units", n), ("input_units", m)):
        values = getattr(dynamics, field, None)
        if values is not None and (not isinstance(values, tuple | list) or len(values) != count):
            raise MistakenMethodError(dynamics, field, f"a tuple of {count} units", repr(values))
    x = ca.SX.sym("x", n)
    allowed: list[list[Shape]] = [[(n,)], [(n, m)], [(2,), (3,)]]
    for method, shapes in zip(("drift", "actuation", "position"), allowed, strict=True):
        require_expression(dynamics, method, shapes, getattr(dynamics, method)(x), symbols=[x])
    _require_polytope(dynamics, x, m)
    _require_metric(dynamics, m)


def _count(dynamics: Dynamics, field: str) -> int:
    expected = "a tuple of different names"
    names: Any = getattr(dynamics, field)
    are_names = isinstance(names, tuple | list) and all(isinstance(name, str) for name in names)
    if not are_names or not names or len(set(names)) < len(names):
        raise MistakenMethodError(dynamics, field, expected, repr(names))
    return len(names)


def _require_polytope(dynamics: Dynamics, x: ca.SX, m: int) -> None:
    expected = f"A(x) of shape (r, {m}) and b(x) of shape (r,)"
    sides: Any = dynamics.input_polytope(x)
    if not isinstance(sides, tuple | list) or len(sides) != 2:
        got = f"{len(sides)} values" if isinstance(sides, tuple | list) else type(sides).__name__
        raise MistakenMethodError(dynamics, "input_polytope", expected, got)
    A, b = sides
    rows = int(getattr(A, "shape", (0,))[0])
    A = require_expression(dynamics, "input_polytope", [(rows, m)], A, symbols=[x])
    b = require_expression(dynamics, "input_polytope", [(rows,)], b, symbols=[x])
    try:
        constant_polytope(A, b)
    except EmptyPolytopeError as error:
        expected = "a compact set that is not empty"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_metric(dynamics: Dynamics, m: int) -> None:
    expected = f"{m} weights above 0"
    weights = dynamics.input_metric()
    try:
        right = len(weights) == m and all(0.0 < float(w) < math.inf for w in weights)
    except (TypeError, ValueError):
        right = False
    if not right:
        raise MistakenMethodError(dynamics, "input_metric", expected, repr(weights))


def motion_texts(dynamics: Sequence[Dynamics]) -> list[str]:
    """Serialize each one's expressions of x' and of the output position, to compare dynamics.

    Equality does not tell: a user's dataclass may leave fields out of it.
    """
    different = {id(model): model for model in dynamics}
    texts = {number: _motion_text(model) for number, model in different.items()}
    return [texts[id(model)] for model in dynamics]


def _motion_text(dynamics: Dynamics) -> str:
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    outputs = [ca.densify(rate), ca.densify(dynamics.position(x))]
    text: str = ca.Function("motion", [x, u], outputs).serialize()
    return text


def weighted_rates(
    field: ca.Function, x: ca.SX, u: ca.SX, pushes: tuple[ca.SX, ca.SX, ca.SX], dt: ca.SX
) -> ca.SX:
    """Six times the mean rate of a classical Runge-Kutta step, shape (n,).

    pushes: φ at its begin, middle and end.
    """
    begin, middle, end = pushes
    k1 = field(x, u) + begin
    k2 = field(x + dt / 2 * k1, u) + middle
    k3 = field(x + dt / 2 * k2, u) + middle
    k4 = field(x + dt * k3, u) + end
    return k1 + 2 * k2 + 2 * k3 + k4
