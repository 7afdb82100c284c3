"""Bound an agent's motion by a box, and check recorded states against its equation of motion."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.scenario.agents import AgentGroup
from phalanx.theory.arrays import Array, Mask
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx_certify.checker.interval_function import IntervalFunction
from phalanx_certify.checker.intervals import (
    Interval,
    UncertifiableError,
    UndecidedError,
    absolute,
    add,
    inside,
    multiply,
    norm,
    point,
    subtract,
)

_ENCLOSURES = 5
"""Number of boxes to try before a motion counts as unbounded."""
_ACTUATOR = 2e-5
"""Allowance for inputs outside U: actuators accept 1e-5 beyond every face."""
_DEFECT = 1e-4
"""Allowed defect of a motion [1/s], as the plant takes Runge-Kutta steps; and as much again for the
rounding of recorded states. Both count as disturbance for certificates."""
_PIECES = (1, 4, 16, 64, 256)
"""Numbers of pieces into which a time is divided, in turn."""
_ORDER = 5
"""Highest order of Taylor expansions."""
_ROUNDING = 2.0**-48
"""Allowed rounding error of a recorded state, relative to its largest component."""
_STRETCH = 1e-3
"""Time over which rounding errors are counted together [s]."""
_TINY = 1e-150
"""Squares of smaller numbers underflow."""


class Motion(NamedTuple):
    """Bounds of s motions within their times."""

    box: Interval
    """All states of the motion, shape (n, s)."""
    rates: Interval
    """f + g u, without φ, over the box, shape (n, s)."""
    proven: Mask
    """Whether it is proven not to leave the box, shape (s,)."""


class GroupMotion:
    """Motions of the agents of a group: bounds from their dynamics, inputs and disturbance."""

    def __init__(self, group: AgentGroup, latency: float) -> None:
        """Compile the bounds. Raises UndecidedError if the input polytope depends on the state."""
        dynamics: Dynamics = group.dynamics_object()
        self.disturbance = float(np.nextafter(group.disturbance.bound + 2 * _DEFECT, np.inf))
        """φ^max, the allowed defect of the plant's integration, and what rounding may add."""
        self.longest = group.clock.period + group.clock.jitter + latency
        """Longest planned time between two inputs [s]."""
        self.x = ca.SX.sym("x", len(dynamics.states))
        self.u = ca.SX.sym("u", len(dynamics.inputs))
        self.rate = dynamics.drift(self.x) + dynamics.actuation(self.x) @ self.u
        """f + g u as an expression of x and u, shape (n,)."""
        self._field = IntervalFunction([self.x, self.u], [self.rate])
        polytope = constant_polytope(*dynamics.input_polytope(self.x))
        if polytope is None:
            raise UndecidedError(f"the inputs that agent {group.names[0]} may apply vary with x")
        low, high = polytope.corners.min(axis=0), polytope.corners.max(axis=0)
        self._inputs = Interval(low[:, None] - _ACTUATOR, high[:, None] + _ACTUATOR)

    def admits(self, u: Array) -> Mask:
        """Return which inputs u, shape (m, s), an actuator accepts."""
        return inside(point(u), self._inputs)

    def anywhere(self, s: int) -> Interval:
        """The interval of all inputs, shape (m, s)."""
        shape = len(self._inputs.lo), s
        return Interval(
            *(np.broadcast_to(end, shape) for end in (self._inputs.lo, self._inputs.hi))
        )

    def moved(self, x: Array, u: Interval, T: Array, pieces: tuple[int, ...] = (1,)) -> Motion:
        """Bound motions over [0, T] from x, shape (n, s), under u, shape (m, s), and any φ.

        pieces: numbers of pieces of T, tried in turn until a box is found.
        """
        motion = self._in_pieces(x, u, T, pieces[0])
        for more in pieces[1:]:
            lost = np.flatnonzero(~motion.proven)
            if lost.size:
                again = self._in_pieces(x[:, lost], u[:, lost], T[lost], more)
                for old, new in zip(motion[:2], again[:2], strict=True):
                    old.lo[:, lost], old.hi[:, lost] = new.lo, new.hi
                motion.proven[lost] = again.proven
        return motion

    def enclosed(self, begin: Interval, u: Interval, T: Array) -> Motion:
        """Bound motions from `begin`, shape (n, s), by one Picard enclosure over all of T."""
        phi = np.full((len(begin.lo), 1), self.disturbance)
        span = Interval(np.zeros_like(T), T)
        size = np.maximum(np.abs(begin.lo), np.abs(begin.hi))
        box = begin
        for _ in range(_ENCLOSURES):
            (rates,), smooth = self._field(box, u)
            reached = add(begin, multiply(span, add(rates, Interval(-phi, phi))))
            stays = inside(reached, box)
            if stays.all():
                break
            margin = 0.1 * (reached.hi - reached.lo) + 16 * np.spacing(size)
            wider = Interval(reached.lo - margin, reached.hi + margin)
            box = Interval(np.where(stays, box.lo, wider.lo), np.where(stays, box.hi, wider.hi))
        return Motion(reached, rates, stays & smooth)

    def _in_pieces(self, x: Array, u: Interval, T: Array, pieces: int) -> Motion:
        """Bound the motions piece by piece of T, each from the end of the last one."""
        phi = np.full((len(x), 1), self.disturbance)
        span, at, parts = T / pieces, point(x), list[Motion]()
        for _ in range(pieces):
            if parts:
                at = add(at, multiply(point(span), add(parts[-1].rates, Interval(-phi, phi))))
            parts.append(self.enclosed(at, u, span))
        box, rates = _hull([p.box for p in parts]), _hull([p.rates for p in parts])
        return Motion(box, rates, np.logical_and.reduce([p.proven for p in parts]))


def _hull(parts: list[Interval]) -> Interval:
    return Interval(
        np.minimum.reduce([p.lo for p in parts]), np.maximum.reduce([p.hi for p in parts])
    )


class Reached(NamedTuple):
    """The ends of s motions, bounded."""

    y: Interval
    """The end without disturbance, shape (n, s)."""
    distance: Array
    """Largest distance from there with disturbance, shape (s,)."""
    proven: Mask
    """Whether these bounds are proven, shape (s,)."""


class MotionCheck:
    """Encloses a group's motions under known inputs, and compares recorded states with them.

    Let y be the motion without disturbance from one recorded state, and x the real one, both within
    a box B. With J the Jacobian of f + g u and μ at least the largest eigenvalue of (J + Jᵀ)/2 over
    B,

        ‖x(h) - y(h)‖ <= e^{μh} ‖x(0) - y(0)‖ + φ^max (e^{μh} - 1)/μ,

    and (e^{μh} - 1)/μ, h times the mean of e^s from 0 to μh, is at most h (1 + e^{μh})/2. y(h) is
    enclosed by a Taylor expansion along f + g u: the last derivative is taken over B, all others at
    y(0). Its order is the highest without a jump in B; where J has no bound it is the first, and

        x(h) is within ‖x(0) - y(0)‖ + h φ^max of y(0) + h F(B).

    The time is divided until a state is proven to be within that distance, or beyond it.
    """

    def __init__(self, motion: GroupMotion) -> None:
        self._motion = motion
        x, u, rate = motion.x, motion.u, motion.rate
        jacobian = ca.jacobian(rate, x)
        even = 0.5 * (jacobian + jacobian.T)
        # Gershgorin: no eigenvalue is above the largest of these.
        rows = ca.diag(even) + ca.sum2(ca.fabs(even)) - ca.fabs(ca.diag(even))
        self._rows = IntervalFunction([x, u], [rows])
        derivatives = [rate]
        for _ in range(_ORDER - 1):
            derivatives.append(ca.jtimes(derivatives[-1], x, rate))
        self._at = IntervalFunction([x, u], derivatives[:-1])
        self._over = {
            order: IntervalFunction([x, u], derivatives[1:order]) for order in range(_ORDER, 1, -1)
        }
        """Derivatives from the second on, by the order of the last."""
        mu, h, distance, phi = (ca.SX.sym(name) for name in ("mu", "h", "distance", "phi"))
        grown = ca.exp(mu * h)
        self._distance = IntervalFunction(
            [mu, h, distance, phi], [grown * distance + phi * h * (1 + grown) / 2]
        )

    def require(self, name: str, t: Array, x: Array, u: Array) -> None:
        """Raise UncertifiableError unless each state after the first may follow the one before.

        UndecidedError where that is not known. Times t [s] and states x have shapes (e,) and (n,
        e); u, held from each but the last, (m, e - 1).
        """
        may, beyond = self._followed(t, x, u)
        if (beyond > 0.0).any():
            k = int(np.argmax(beyond > 0.0))
            raise UncertifiableError(
                f"agent {name} moves otherwise than its inputs and disturbances allow, "
                f"at t = {t[k]:.6f} s: after {t[k + 1] - t[k]:.3g} s it is {beyond[k]:.2g} beyond"
            )
        if not may.all():
            k = int(np.argmin(may))
            raise UndecidedError(
                f"whether agent {name} can move as recorded from t = {t[k]:.6f} s to "
                f"{t[k + 1]:.6f} s: its motion was not bounded closely enough"
            )

    def _followed(self, t: Array, x: Array, u: Array) -> tuple[Mask, Array]:
        """Return which states may follow, shape (e - 1,), and by how much others are too far."""
        begin, end, dt = point(x[:, :-1]), point(x[:, 1:]), subtract(point(t[1:]), point(t[:-1]))
        may, beyond = np.zeros(len(t) - 1, dtype=bool), np.zeros(len(t) - 1)
        for pieces in _PIECES:
            todo = np.flatnonzero(~may & (beyond == 0.0))
            if not todo.size:
                break
            span = Interval(np.maximum(dt.lo[todo], 0.0), dt.hi[todo])
            ends = self.reached(begin[:, todo], point(u[:, todo]), span, pieces)
            off = norm(absolute(subtract(end[:, todo], ends.y)))
            size = np.maximum(np.abs(begin.lo), np.abs(end.lo))[:, todo].max(axis=0)
            allowed = _TINY + ends.distance + _ROUNDING * size
            may[todo] = ends.proven & (off.hi <= allowed)
            beyond[todo] = np.where(ends.proven, np.maximum(off.lo - allowed, 0.0), 0.0)
        return may, beyond

    def reached(self, begin: Interval, u: Interval, T: Interval, pieces: int) -> Reached:
        """Bound motions from `begin`, shape (n, s), after T, shape (s,), divided into pieces."""
        h = multiply(T, point(1.0 / pieces))
        y, distance = begin, np.zeros_like(h.lo)
        proven = np.ones(h.lo.shape, dtype=bool)
        phi = point(np.full((1, len(distance)), self._motion.disturbance - _DEFECT))
        for _ in range(pieces):
            within = self._motion.enclosed(add(y, Interval(-distance, distance)), u, h.hi)
            (rows,), _ = self._rows(within.box, u)
            mu = Interval(rows.hi.max(axis=0)[None], rows.hi.max(axis=0)[None])
            (grown,), _ = self._distance(mu, h[None], point(distance[None]), phi)
            lipschitz = np.isfinite(grown.hi[0])
            y = self._undisturbed(y, u, h, within, lipschitz)
            # Without a bound of J: a motion of h F within B, and the effect of φ.
            pushed = add(point(distance), multiply(phi[0], h)).hi
            distance = np.where(lipschitz, grown.hi[0], pushed)
            proven &= within.proven & np.isfinite(distance)
            if not proven.any():
                break
        return Reached(y, distance, proven)

    def _undisturbed(
        self, y: Interval, u: Interval, h: Interval, within: Motion, smooth: Mask
    ) -> Interval:
        """Bound motions from y after h without disturbance; of first order unless smooth."""
        end, pending = add(y, multiply(h, within.rates)), smooth.copy()
        derivatives, _ = self._at(y, u)
        for order, function in self._over.items():
            over, constant = function(within.box, u)
            sums = _taylor(y, [*derivatives[: order - 1], over[-1]], h)
            some = pending & constant & np.isfinite([sums.lo, sums.hi]).all(axis=(0, 1))
            end = Interval(np.where(some, sums.lo, end.lo), np.where(some, sums.hi, end.hi))
            pending &= ~some
            if not pending.any():
                break
        return end


def require_digits(t: Array, x: Array) -> None:
    """Raise UndecidedError where all that is allowed for rounding may be above _DEFECT in a second.

    It is counted over _STRETCH, as events may be one float64 apart. t [s] and x: shapes (e,) and
    (n, e).
    """
    number = np.arange(1, len(t) + 1) - np.searchsorted(t, t - _STRETCH, side="right")
    if number.max() * _ROUNDING * np.abs(x).max() > _DEFECT * _STRETCH:
        raise UndecidedError(
            f"whether the agents move as recorded: {number.max()} states within {_STRETCH:g} s, "
            "as far from the origin as these, have too few digits"
        )


def _taylor(y: Interval, derivatives: Sequence[Interval], h: Interval) -> Interval:
    """y + h y' + h²/2 y'' + ..."""
    value, term = y, point(np.ones_like(h.lo))
    for k, derivative in enumerate(derivatives, start=1):
        share = Interval(np.nextafter(1.0 / k, 0.0), np.nextafter(1.0 / k, 2.0))
        term = multiply(multiply(term, h), share)
        value = add(value, multiply(term, derivative))
    return value
