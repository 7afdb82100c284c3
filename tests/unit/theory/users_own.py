"""Dynamics and safe-set functions as a user would write them, with numpy twins to check against.

Each class has `f`, `g`: the same expressions in plain numpy, written apart from the CasADi ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from scipy.special import logsumexp

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import box_polytope
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Body, Separation
from phalanx.theory.safety.obstacles import Sphere


@dataclass(frozen=True)
class Drifter:
    """A point in a current, whose thrusters act unequally: f and g depend on the state."""

    thrust: float = 2.0

    states = ("x", "y", "z")
    inputs = ("fore", "side")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.sin(x[1]), -0.3 * x[0] * x[2], ca.cos(x[0] + x[1]))

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(
            ca.horzcat(1.0 + x[1] ** 2, 0.5),
            ca.horzcat(ca.sin(x[2]), 2.0),
            ca.horzcat(x[0], 1.0),
        )

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        # A triangle that grows with x.
        return ca.SX([[-1, 0], [0, -1], [1, 1]]), ca.vertcat(1, 1, self.thrust + ca.tanh(x[0]))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 3.0)

    def f(self, x: Array) -> Array:
        return np.array([np.sin(x[1]), -0.3 * x[0] * x[2], np.cos(x[0] + x[1])])

    def g(self, x: Array) -> Array:
        return np.array([[1.0 + x[1] ** 2, 0.5], [np.sin(x[2]), 2.0], [x[0], 1.0]])


@dataclass(frozen=True)
class Boosted(SingleIntegrator):
    """A single integrator that moves faster than its input, and equals a slower one by `==`."""

    gain: float = field(default=1.0, compare=False)

    def actuation(self, x: ca.SX) -> ca.SX:
        return self.gain * super().actuation(x)


@dataclass(frozen=True)
class OutputUnicycle:
    """A unicycle as the paper prints it: the input is the output's velocity, Eq. (IOoutputs)."""

    speed: float = 4.0
    turn_rate: float = 2.0
    offset: float = 0.25

    states = ("x", "y", "theta")
    inputs = ("u1", "u2")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(3)

    def actuation(self, x: ca.SX) -> ca.SX:
        cos, sin, b = ca.cos(x[2]), ca.sin(x[2]), self.offset
        native = ca.vertcat(ca.horzcat(cos, sin), ca.horzcat(-sin / b, cos / b))
        return ca.vertcat(ca.horzcat(cos, 0), ca.horzcat(sin, 0), ca.SX([[0, 1]])) @ native

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2] + self.offset * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]))

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        cos, sin, b = ca.cos(x[2]), ca.sin(x[2]), self.offset
        A = ca.vertcat(
            ca.horzcat(cos, sin),
            ca.horzcat(-cos, -sin),
            ca.horzcat(-sin / b, cos / b),
            ca.horzcat(sin / b, -cos / b),
        )
        return A, ca.SX([self.speed, self.speed, self.turn_rate, self.turn_rate])

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 1.0)

    def native(self, theta: float) -> Array:
        """(ν, ω) = native(θ) u, below Eq. (IOoutputs)."""
        cos, sin = np.cos(theta), np.sin(theta)
        return np.array([[cos, sin], [-sin / self.offset, cos / self.offset]])

    def f(self, x: Array) -> Array:
        return np.zeros(3)

    def g(self, x: Array) -> Array:
        ahead = np.array([[np.cos(x[2]), 0], [np.sin(x[2]), 0], [0, 1]])
        return ahead @ self.native(x[2])


@dataclass(frozen=True)
class Draggy:
    """Double integrator with drag: p' = v, v' = -β v + u; relative degree 2."""

    drag: float = 0.7
    force: float = 3.0

    states = ("x", "y", "vx", "vy")
    inputs = ("ax", "ay")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[2:], -self.drag * x[2:])

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.SX.zeros(2, 2), ca.SX.eye(2))

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.force, self.force))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 1.0)

    def f(self, x: Array) -> Array:
        return np.concatenate([x[2:], -self.drag * x[2:]])

    def g(self, x: Array) -> Array:
        return np.vstack([np.zeros((2, 2)), np.eye(2)])


@dataclass(frozen=True)
class Jerky:
    """Triple integrator on a line in the plane's x: relative degree 3, one input."""

    jerk: float = 1.0

    states = ("x", "y", "v", "a")
    inputs = ("j",)

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[2], 0, x[3], 0)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.SX([[0], [0], [0], [1]])

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.jerk,))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,)

    def f(self, x: Array) -> Array:
        return np.array([x[2], 0.0, x[3], 0.0])

    def g(self, x: Array) -> Array:
        return np.array([[0.0], [0.0], [0.0], [1.0]])


@dataclass(frozen=True)
class Rail:
    """A cart on a rail: one input, whose bound shrinks away from the origin."""

    push: float = 1.0

    states = ("x", "y")
    inputs = ("v",)

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(2)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.SX([[1], [0]])

    def position(self, x: ca.SX) -> ca.SX:
        return x

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        bound = self.push / (1 + x[0] ** 2)
        return ca.SX([[1], [-1]]), ca.vertcat(bound, bound)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,)


@dataclass(frozen=True)
class Oval:
    """h = 1 - (D_1/a)² - (D_2/b)² + D_1 D_2 / 50: pairs keep out of each other's ellipse."""

    a: float = 1.5
    b: float = 0.8

    def between(self, a: Body, b: Body) -> ca.SX:
        return self._of(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Sphere) -> ca.SX:
        return self._of(a.p - ca.DM(obstacle.center)) + obstacle.clearance

    def _of(self, d: ca.SX) -> ca.SX:
        return 1 - (d[0] / self.a) ** 2 - (d[1] / self.b) ** 2 + d[0] * d[1] / 50


@dataclass(frozen=True)
class ShortSighted(Separation):
    """Separation of its own that says it reaches a hundredth as far as it does."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return 4.0 * self.radius * self.radius - ca.sumsqr(a.p - b.p)

    def reach(self, level: float, obstacle: object = None) -> float:
        return 0.01 * self.radius


@dataclass(frozen=True)
class Reaches(Oval):
    """An ellipse with a number that is called reach."""

    reach: float = 3.0


class Twin:
    """h_tot and every member's f and g again, in numpy."""

    def __init__(
        self,
        members: Sequence[Member],
        obstacles: Sequence[Sphere],
        function: Separation | Oval,
        rho: float,
    ) -> None:
        self.members, self.obstacles, self.function, self.rho = members, obstacles, function, rho
        ends = np.cumsum([len(m.dynamics.states) for m in members])
        self.parts = [
            slice(int(end) - len(m.dynamics.states), int(end))
            for end, m in zip(ends, members, strict=True)
        ]

    def h(self, x: Array) -> Array:
        p = [self.position(l, x) for l in range(len(self.members))]
        normal = [l for l, m in enumerate(self.members) if not m.adversary]
        found = [self._pair(p[i] - p[j]) for i in normal for j in normal if i < j]
        adversaries = [l for l, m in enumerate(self.members) if m.adversary]
        found += [self._pair(p[i] - p[j]) for i in normal for j in adversaries]
        for i in normal:
            clear = [(np.array(o.center), o.clearance) for o in self.obstacles]
            found += [self._obstacle(p[i] - center, clearance) for center, clearance in clear]
        return np.array(found)

    def h_tot(self, x: Array) -> float:
        return float(logsumexp(self.rho * self.h(x)) / self.rho)

    def position(self, l: int, x: Array) -> Array:
        own, dynamics = x[self.parts[l]], self.members[l].dynamics
        if isinstance(dynamics, Unicycle | OutputUnicycle):
            return own[:2] + dynamics.offset * np.array([np.cos(own[2]), np.sin(own[2])])
        return own[: dynamics.dimension if isinstance(dynamics, SingleIntegrator) else 2]

    def f(self, l: int, x: Array) -> Array:
        """f_l in the place of member l, zero elsewhere; shape (n̄,)."""
        dynamics, found = self.members[l].dynamics, np.zeros_like(x)
        if not isinstance(dynamics, Unicycle | SingleIntegrator):
            found[self.parts[l]] = dynamics.f(x[self.parts[l]])
        return found

    def g(self, l: int, x: Array) -> Array:
        """g_l in the place of member l, zero elsewhere; shape (n̄, m_l)."""
        dynamics, own = self.members[l].dynamics, x[self.parts[l]]
        found = np.zeros((len(x), len(dynamics.inputs)))
        if isinstance(dynamics, Unicycle):
            found[self.parts[l]] = [[np.cos(own[2]), 0], [np.sin(own[2]), 0], [0, 1]]
        elif isinstance(dynamics, SingleIntegrator):
            found[self.parts[l]] = np.eye(dynamics.dimension)
        else:
            found[self.parts[l]] = dynamics.g(own)
        return found

    def _pair(self, d: Array) -> float:
        f = self.function
        if isinstance(f, Separation):
            return float(f.radius**2 - d @ d)
        return float(1 - (d[0] / f.a) ** 2 - (d[1] / f.b) ** 2 + d[0] * d[1] / 50)

    def _obstacle(self, d: Array, radius: float) -> float:
        if isinstance(self.function, Separation):
            return float(radius**2 - d @ d)
        return self._pair(d) + radius


@dataclass
class Case:
    """A swarm's safe set with its numpy twin."""

    composed: ComposedSet
    twin: Twin


def swarm_of(
    dynamics: Sequence[object],
    *,
    adversaries: int = 1,
    function: Separation | Oval | None = None,
    rho: float = 2.0,
    obstacles: Sequence[Sphere] = (Sphere((3.0, 1.0), 1.2),),
) -> Case:
    """A swarm whose last `adversaries` members attack; members are named a, b, c, ..."""
    normal = len(dynamics) - adversaries
    members = [
        Member("abcdefgh"[l], d, l >= normal)  # type: ignore[arg-type]
        for l, d in enumerate(dynamics)
    ]
    function = function or Separation(1.0)
    return Case(compose(members, obstacles, function, rho), Twin(members, obstacles, function, rho))


def along(function: object, x: Array, direction: Array, step: float = 1e-5) -> float:
    """The derivative of function at x along a direction, by central differences."""
    ahead, behind = function(x + step * direction), function(x - step * direction)  # type: ignore[operator]
    return float((ahead - behind) / (2 * step))
