"""Dynamics and safe-set functions as a user would write them, and h_tot again in numpy."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.special import logsumexp

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import SingleIntegrator
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
            ca.horzcat(1.0 + x[1] ** 2, 0.5), ca.horzcat(ca.sin(x[2]), 2.0), ca.horzcat(x[0], 1.0)
        )

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        # A triangle that grows with x.
        return ca.SX([[-1, 0], [0, -1], [1, 1]]), ca.vertcat(1, 1, self.thrust + ca.tanh(x[0]))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 3.0)


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
class Between:
    """h of two output points."""

    h: Callable[[ca.SX, ca.SX], ca.SX]

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.h(a.p, b.p)


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
    """h_tot again, in numpy, and each member's f and g within the whole state."""

    def __init__(
        self,
        members: Sequence[Member],
        obstacles: Sequence[Sphere],
        function: Separation | Oval,
        rho: float,
    ) -> None:
        self.members, self.obstacles, self.function, self.rho = members, obstacles, function, rho
        ends = np.cumsum([0, *(len(m.dynamics.states) for m in members)]).tolist()
        self.parts = [slice(*pair) for pair in pairwise(ends)]

    @cached_property
    def _fields(self) -> list[CompiledFunction]:
        """Functions of the members: x -> f, g and the output point."""
        return [_field(m) for m in self.members]

    def h(self, x: Array) -> Array:
        p = [self.position(l, x) for l in range(len(self.members))]
        normal = [l for l, m in enumerate(self.members) if not m.adversary]
        adversaries = [l for l, m in enumerate(self.members) if m.adversary]
        pairs = [(i, j) for i in normal for j in normal if i < j]
        pairs += [(i, j) for i in normal for j in adversaries]
        values = [self._pair(p[i] - p[j]) for i, j in pairs]
        for i in normal:
            values += [
                self._obstacle(p[i] - np.array(o.center), o.clearance) for o in self.obstacles
            ]
        return np.array(values)

    def h_tot(self, x: Array) -> float:
        return float(logsumexp(self.rho * self.h(x)) / self.rho)

    def position(self, l: int, x: Array) -> Array:
        return self._fields[l](x[self.parts[l]])[2]

    def f(self, l: int, x: Array) -> Array:
        """f_l at the states of member l, zero elsewhere; shape (n̄,)."""
        drift = np.zeros_like(x)
        drift[self.parts[l]] = self._fields[l](x[self.parts[l]])[0]
        return drift

    def g(self, l: int, x: Array) -> Array:
        """g_l at the states of member l, zero elsewhere; shape (n̄, m_l)."""
        actuation = np.zeros((len(x), len(self.members[l].dynamics.inputs)))
        actuation[self.parts[l]] = self._fields[l](x[self.parts[l]])[1]
        return actuation

    def _pair(self, d: Array) -> float:
        f = self.function
        if isinstance(f, Separation):
            return float(f.radius**2 - d @ d)
        return float(1 - (d[0] / f.a) ** 2 - (d[1] / f.b) ** 2 + d[0] * d[1] / 50)

    def _obstacle(self, d: Array, radius: float) -> float:
        if isinstance(self.function, Separation):
            return float(radius**2 - d @ d)
        return self._pair(d) + radius


def _field(member: Member) -> CompiledFunction:
    x, dynamics = ca.SX.sym("x", len(member.dynamics.states)), member.dynamics
    outputs = [dynamics.drift(x), dynamics.actuation(x), dynamics.position(x)]
    return CompiledFunction([x], outputs)


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


def pair_of(
    dynamics: Sequence[object], function: object = None, *, adversary: bool = True
) -> ComposedSet:
    """Two agents, the second perhaps an adversary."""
    case = swarm_of(dynamics, adversaries=int(adversary), function=function, obstacles=())
    return case.composed.alone(0)


def runge_kutta(rate: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """The state dt later, by a step of the classical method."""
    k1 = rate(x)
    k2 = rate(x + dt / 2 * k1)
    k3 = rate(x + dt / 2 * k2)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + dt * k3))


def along(function: object, x: Array, direction: Array, step: float = 1e-5) -> float:
    """The derivative of function at x along a direction, by central differences."""
    ahead, behind = function(x + step * direction), function(x - step * direction)  # type: ignore[operator]
    return float((ahead - behind) / (2 * step))
