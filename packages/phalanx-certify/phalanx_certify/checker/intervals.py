"""Interval arithmetic on arrays, rounded outwards.

Every result contains the true value for every choice of numbers from the arguments. Arithmetic is
rounded to nearest and then widened by one float64, and library functions are widened by more than
their documented error. Unknown results are everything, from -inf to inf, and never NaN.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phalanx.theory.arrays import Array, Mask

_LIBRARY = 8
"""Widening of library functions [ulp]; numpy's vectorised ones may be off by 4."""


class UncertifiableError(ValueError):
    """A recording contradicts its scenario; the message says how."""


class UndecidedError(UncertifiableError):
    """A recording can be neither certified nor refused; the message says why."""


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from lo to hi, for each element of two arrays of one shape."""

    lo: Array
    hi: Array

    def __getitem__(self, index: Any) -> "Interval":
        """The same elements of both ends."""
        return Interval(self.lo[index], self.hi[index])


def point(value: Array | float) -> Interval:
    """The interval of one number."""
    array = np.asarray(value, dtype=np.float64)
    return Interval(array, array)


def stack(parts: Sequence[Interval]) -> Interval:
    """Stack intervals of shapes (n_l, s)."""
    return Interval(np.concatenate([p.lo for p in parts]), np.concatenate([p.hi for p in parts]))


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return outward(a.lo + b.lo, a.hi + b.hi)


def subtract(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return outward(a.lo - b.hi, a.hi - b.lo)


def multiply(a: Interval, b: Interval) -> Interval:
    """a b."""
    ends = a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi
    low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    high = np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
    return outward(low, high)


def square(a: Interval) -> Interval:
    """a²."""
    size = absolute(a)
    return nonnegative(outward(size.lo * size.lo, size.hi * size.hi))


def root(a: Interval) -> Interval:
    """√a; everything where a reaches below zero."""
    defined = a.lo >= 0.0
    roots = outward(np.sqrt(np.maximum(a.lo, 0.0)), np.sqrt(np.maximum(a.hi, 0.0)))
    return where(defined, nonnegative(roots))


def absolute(a: Interval) -> Interval:
    """|a|."""
    low, high = np.abs(a.lo), np.abs(a.hi)
    crosses = (a.lo <= 0.0) & (a.hi >= 0.0)
    return Interval(np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high))


def total(a: Interval) -> Interval:
    """The sum along the first axis; 0 of nothing."""
    result = point(np.zeros(a.lo.shape[1:]))
    for k in range(len(a.lo)):
        result = add(result, a[k])
    return result


def dot(a: Interval, b: Interval) -> Interval:
    """The sum of products along the first axis."""
    return total(multiply(a, b))


def norm(a: Interval) -> Interval:
    """Euclidean, along the first axis."""
    return root(nonnegative(total(square(a))))


def inside(a: Interval, b: Interval) -> Mask:
    """Return whether a lies within b in every component, along the first axis."""
    mask: Mask = np.logical_and.reduce((a.lo >= b.lo) & (a.hi <= b.hi), axis=0)
    return mask


def outward(low: Array, high: Array) -> Interval:
    """Widen by one float64 on both sides; everything where an end is NaN."""
    return _defined(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))


def moved(low: Array, high: Array) -> Interval:
    """Widen by the error of library functions, which are not rounded to nearest."""
    margin = _LIBRARY * np.spacing(np.abs(low)), _LIBRARY * np.spacing(np.abs(high))
    return _defined(low - margin[0], high + margin[1])


def _defined(low: Array, high: Array) -> Interval:
    return where(~(np.isnan(low) | np.isnan(high)), Interval(low, high))


def where(defined: Mask, a: Interval) -> Interval:
    """a where it is defined, everything elsewhere."""
    return Interval(np.where(defined, a.lo, -np.inf), np.where(defined, a.hi, np.inf))


def nonnegative(a: Interval) -> Interval:
    """The part of a that is not below zero."""
    return Interval(np.maximum(a.lo, 0.0), a.hi)
