"""Bound an agent's motion by a box, for all its inputs and disturbances."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Mask
from phalanx.certify.checker.interval_function import IntervalFunction
from phalanx.certify.checker.intervals import (
    Interval,
    UndecidedError,
    add,
    inside,
    multiply,
    point,
)
from phalanx.scenario.agents import AgentGroup
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope

_ENCLOSURES = 5
"""Number of boxes to try before a motion counts as unbounded."""
_ACTUATOR = 2e-5
"""Allowance for inputs outside U: actuators accept 1e-5 beyond every face."""
_DEFECT = 1e-4
"""Allowed defect of a motion [1/s], as the plant takes Runge-Kutta steps. It counts as disturbance,
for certificates too."""


class Motion(NamedTuple):
    """Bounds of s motions within their times."""

    box: Interval
    """All states of the motion, shape (n, s)."""
    rates: Interval
    """f + g u, without φ, over the box, shape (n, s)."""
    known: Mask
    """Whether it is proven not to leave the box, shape (s,)."""


class GroupMotion:
    """Motions of the agents of a group: bounds from their dynamics, inputs and disturbance."""

    def __init__(self, group: AgentGroup, latency: float) -> None:
        """Compile the bounds. Raises UndecidedError if the input polytope depends on the state."""
        dynamics: Dynamics = group.dynamics_object()
        self.disturbance = float(np.nextafter(group.disturbance.bound + _DEFECT, np.inf))
        """φ^max, and the allowed defect of the plant's integration."""
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
        found = self._in_pieces(x, u, T, pieces[0])
        for more in pieces[1:]:
            lost = np.flatnonzero(~found.known)
            if lost.size:
                again = self._in_pieces(x[:, lost], u[:, lost], T[lost], more)
                for old, new in zip(found[:2], again[:2], strict=True):
                    old.lo[:, lost], old.hi[:, lost] = new.lo, new.hi
                found.known[lost] = again.known
        return found

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
        return Motion(box, rates, np.logical_and.reduce([p.known for p in parts]))


def _hull(parts: list[Interval]) -> Interval:
    return Interval(
        np.minimum.reduce([p.lo for p in parts]), np.maximum.reduce([p.hi for p in parts])
    )
