"""Desired positions: a formation whose centre follows a Bezier path under a timing law."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, MinLen

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.circular import cos, sin
from phalanx.theory.expressions.exact import dot
from phalanx.theory.expressions.portable import portable_value
from phalanx.theory.laws.goals import Goal, Sight


@dataclass(frozen=True)
class Formation:
    """Slots on a circle whose centre runs along B(s(t)), s(t) = t / finish, then rests."""

    path: Annotated[tuple[tuple[float, ...], ...], MinLen(2)]
    """Control points of the Bezier curve [m], in 2-D or 3-D."""
    finish: Annotated[float, Gt(0)]
    """t_f [s]: when the centre reaches the last control point."""
    radius: Annotated[float, Ge(0)]
    """Radius of the circle of slots, in the xy plane [m]."""
    slots: Annotated[int, Ge(1)]
    """Number of slots; slot k is at the angle 2πk/slots."""

    def __post_init__(self) -> None:
        if len({len(point) for point in self.path}) != 1 or len(self.path[0]) not in (2, 3):
            raise ValueError("path: expected control points that are all 2-D or all 3-D")

    def center(self, t: float) -> Goal:
        """The formation's centre at time t [s]."""
        return self._at(t, self._path_polynomial)

    def goal(self, slot: int, t: float) -> Goal:
        """The desired position of the agent in a slot at time t [s]."""
        return self._at(t, self._slot_polynomials[slot])

    def positions(self, slot: int, t: Array) -> Array:
        """Return a slot's places at s times [s], shape (s, d) [m]; the bits are those of goal."""
        s, polynomial = np.minimum(t / self.finish, 1.0)[:, None], self._slot_polynomials[slot]
        values = polynomial[-1, : len(self.path[0])] + np.zeros_like(s)
        for coefficients in polynomial[-2::-1, : len(self.path[0])]:
            values = values * s + coefficients
        return values

    def polynomial(self, slot: int) -> Array:
        """Return a slot's coefficients of s: position and derivatives, shape (degree + 1, 3 d)."""
        return self._slot_polynomials[slot]

    def _at(self, t: float, polynomial: Array) -> Goal:
        s = min(t / self.finish, 1.0)
        values = polynomial[-1]
        for coefficients in polynomial[-2::-1]:
            values = values * s + coefficients
        d = len(self.path[0])
        if t >= self.finish:
            values[d:] = 0.0
        return Goal(values[:d], values[d : 2 * d], values[2 * d :])

    @cached_property
    def _path_polynomial(self) -> Array:
        """Coefficients of B(s) and its two time derivatives, shape (degree + 1, 3 d)."""
        n = len(self.path) - 1
        # Column k of `basis` is the Bernstein polynomial C(n, k) s^k (1-s)^(n-k).
        basis = np.zeros((n + 1, n + 1))
        for k in range(n + 1):
            for j in range(n - k + 1):
                basis[k + j, k] = math.comb(n, k) * math.comb(n - k, j) * (-1) ** j
        derivative = np.diag(np.arange(1.0, n + 1), k=1) / self.finish
        curve = _product(basis, np.array(self.path))
        velocity = _product(derivative, curve)
        return np.hstack([curve, velocity, _product(derivative, velocity)])

    @cached_property
    def _slot_polynomials(self) -> list[Array]:
        """The path's polynomial with each slot's place on the circle added."""
        shifted = []
        for slot in range(self.slots):
            angle = 2.0 * math.pi * slot / self.slots
            polynomial = self._path_polynomial.copy()
            cosine, sine = portable_value(cos, angle), portable_value(sin, angle)
            polynomial[0, :2] += self.radius * cosine, self.radius * sine
            shifted.append(polynomial)
        return shifted


@dataclass(frozen=True)
class Slot:
    """A formation's slot as a reference."""

    formation: Formation
    slot: int

    def goal(self, sight: Sight) -> Goal:
        return self.formation.goal(self.slot, sight.t)

    def end(self) -> Array | None:
        return self.formation.goal(self.slot, self.formation.finish).position


def _product(A: Array, B: Array) -> Array:
    return dot(A[:, None], B.T)
