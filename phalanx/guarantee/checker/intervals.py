"""Interval arithmetic on arrays, rounded outwards, and CasADi expressions evaluated with it.

Every result holds the true value for every choice of numbers from the arguments: arithmetic is
rounded to nearest and then moved one float64 outwards, and library functions are moved by more than
they promise to be wrong. What is not known is everything, from -inf to inf; NaN never goes on.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Truth = NDArray[np.bool_]

_LIBRARY = 8
"""How far library functions are moved [ulp]; numpy's vectorised ones may be wrong by 4."""


class UncertifiableError(ValueError):
    """Nothing can be certified of such expressions; the message says why."""


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from lo to hi, for each element of two arrays of one shape."""

    lo: Array
    hi: Array

    def __getitem__(self, index: Any) -> "Interval":
        """The same elements of both ends."""
        return Interval(self.lo[index], self.hi[index])


def point(value: Array | float) -> Interval:
    """The interval that holds one number."""
    array = np.asarray(value, dtype=np.float64)
    return Interval(array, array)


def stack(parts: Sequence[Interval]) -> Interval:
    """Intervals one below the other, shapes (n_l, s)."""
    return Interval(np.concatenate([p.lo for p in parts]), np.concatenate([p.hi for p in parts]))


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return _outward(a.lo + b.lo, a.hi + b.hi)


def subtract(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return _outward(a.lo - b.hi, a.hi - b.lo)


def multiply(a: Interval, b: Interval) -> Interval:
    """a b."""
    ends = a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi
    low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    high = np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
    return _outward(low, high)


def square(a: Interval) -> Interval:
    """a²."""
    size = absolute(a)
    return _nonnegative(_outward(size.lo * size.lo, size.hi * size.hi))


def root(a: Interval) -> Interval:
    """√a; everything where a reaches below zero."""
    defined = a.lo >= 0.0
    found = _outward(np.sqrt(np.maximum(a.lo, 0.0)), np.sqrt(np.maximum(a.hi, 0.0)))
    return _where(defined, _nonnegative(found))


def absolute(a: Interval) -> Interval:
    """|a|."""
    low, high = np.abs(a.lo), np.abs(a.hi)
    crosses = (a.lo <= 0.0) & (a.hi >= 0.0)
    return Interval(np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high))


def total(a: Interval) -> Interval:
    """The sum along the first axis; 0 of nothing."""
    found = point(np.zeros(a.lo.shape[1:]))
    for k in range(len(a.lo)):
        found = add(found, a[k])
    return found


def dot(a: Interval, b: Interval) -> Interval:
    """The sum of products along the first axis."""
    return total(multiply(a, b))


def norm(a: Interval) -> Interval:
    """Euclidean, along the first axis."""
    return root(_nonnegative(total(square(a))))


def inside(a: Interval, b: Interval) -> Truth:
    """Whether a lies within b in every component, along the first axis."""
    found: Truth = np.logical_and.reduce((a.lo >= b.lo) & (a.hi <= b.hi), axis=0)
    return found


class IntervalFunction:
    """Expressions of vectors, bounded over boxes: one walk through CasADi's instructions.

    The numbers in an expression are taken as CasADi has them, folded in float64.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Column inputs, shape (n,) each, made of symbols; outputs of any shape.

        Raises UncertifiableError, naming an operation for which there is no rule.
        """
        flat = [ca.densify(ca.vec(output)) for output in outputs]
        self._sizes = [output.numel() for output in flat]
        f = self._f = ca.Function("f", [ca.vec(i) for i in inputs], flat, {"cse": True})
        self._program = [
            (f.instruction_id(k), f.instruction_input(k), f.instruction_output(k))
            for k in range(f.n_instructions())
        ]
        known = {*_RULES, *_JUMPS, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
        for op, _, _ in self._program:
            if op not in known:
                raise UncertifiableError(f"no interval rule for the operation {_name(op)!r}")

    def __call__(self, *inputs: Interval) -> tuple[list[Interval], Truth]:
        """Bounds of each output, shapes (size, s), over s boxes, inputs (n, s) each.

        And whether nothing in them can jump there, shape (s,): a sign, a comparison or a rounding
        that is not the same all over a box is a jump, be it only in a derivative (a kink).
        """
        shape = np.broadcast_shapes(*[i.lo.shape[1:] for i in inputs])
        results = [Interval(np.zeros((n, *shape)), np.zeros((n, *shape))) for n in self._sizes]
        smooth = np.ones(shape, dtype=bool)
        work: dict[int, Interval] = {}
        with np.errstate(all="ignore"):
            for k, (op, sources, targets) in enumerate(self._program):
                if op == ca.OP_CONST:
                    work[targets[0]] = point(self._f.instruction_constant(k))
                elif op == ca.OP_INPUT:
                    work[targets[0]] = inputs[sources[0]][sources[1]]
                elif op == ca.OP_OUTPUT:
                    result, value = results[targets[0]], work[sources[0]]
                    result.lo[targets[1]], result.hi[targets[1]] = value.lo, value.hi
                elif op in _RULES:
                    work[targets[0]] = _RULES[op](*[work[s] for s in sources])
                else:
                    work[targets[0]], constant = _JUMPS[op](*[work[s] for s in sources])
                    smooth &= constant
        return results, smooth


def _name(op: int) -> str:
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    return names.get(op, str(op)).removeprefix("OP_").lower()


def _outward(low: Array, high: Array) -> Interval:
    """One float64 wider on both sides; everything where an end is not a number."""
    return _known(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))


def _library(low: Array, high: Array) -> Interval:
    """Wider by what a library function may be wrong."""
    margin = _LIBRARY * np.spacing(np.abs(low)), _LIBRARY * np.spacing(np.abs(high))
    return _known(low - margin[0], high + margin[1])


def _known(low: Array, high: Array) -> Interval:
    return _where(~(np.isnan(low) | np.isnan(high)), Interval(low, high))


def _where(defined: Truth, a: Interval) -> Interval:
    """a where it is defined, else everything."""
    return Interval(np.where(defined, a.lo, -np.inf), np.where(defined, a.hi, np.inf))


def _nonnegative(a: Interval) -> Interval:
    return Interval(np.maximum(a.lo, 0.0), a.hi)


def _reciprocal(a: Interval) -> Interval:
    apart = (a.lo > 0.0) | (a.hi < 0.0)
    return _where(apart, _outward(1.0 / a.hi, 1.0 / a.lo))


def _reaches(a: Interval, phase: float) -> Truth:
    """Whether phase + 2πk may lie in a, for some whole k; in doubt it does."""
    first, last = (a.lo - phase) / (2 * np.pi), (a.hi - phase) / (2 * np.pi)
    doubt = 1e-9 + 1e-12 * np.maximum(np.abs(first), np.abs(last))
    found: Truth = ~(np.ceil(first - doubt) > last + doubt)
    return found


def _wave(function: Callable[[Array], Array], top: float) -> Callable[[Interval], Interval]:
    """Sine or cosine, whose maximum is at `top`."""

    def rule(a: Interval) -> Interval:
        ends = function(a.lo), function(a.hi)
        found = _library(np.minimum(*ends), np.maximum(*ends))
        low = np.where(_reaches(a, top + np.pi), -1.0, np.maximum(found.lo, -1.0))
        return Interval(low, np.where(_reaches(a, top), 1.0, np.minimum(found.hi, 1.0)))

    return rule


def _increasing(
    function: Callable[[Array], Array], least: float = -np.inf, most: float = np.inf
) -> Callable[[Interval], Interval]:
    """A library function that increases on [least, most] and is not defined elsewhere."""
    return lambda a: _where(
        (a.lo >= least) & (a.hi <= most), _library(function(a.lo), function(a.hi))
    )


def _arc_cosine(a: Interval) -> Interval:
    return _where((a.lo >= -1.0) & (a.hi <= 1.0), _library(np.arccos(a.hi), np.arccos(a.lo)))


def _tangent(a: Interval) -> Interval:
    pole = _reaches(a, np.pi / 2) | _reaches(a, -np.pi / 2)
    return _where(~pole, _library(np.tan(a.lo), np.tan(a.hi)))


def _hyperbolic_cosine(a: Interval) -> Interval:
    size = absolute(a)
    return _library(np.cosh(size.lo), np.cosh(size.hi))


def _power(a: Interval, b: Interval) -> Interval:
    """a to the power b: whole and constant, or of a positive a."""
    if b.lo.ndim or b.lo != b.hi or not float(b.lo).is_integer():
        return _exp(multiply(b, _where(a.lo > 0.0, _log(a))))
    n = float(b.lo)
    if n < 0:
        return _reciprocal(_power(a, point(-n)))
    base = absolute(a) if n % 2 == 0 else a
    return _library(base.lo**n, base.hi**n)


_Jumping = Callable[..., tuple[Interval, Truth]]


def _sign(a: Interval) -> tuple[Interval, Truth]:
    # sign(0) is 0, but beside it there is a jump.
    return Interval(np.sign(a.lo), np.sign(a.hi)), (a.lo > 0.0) | (a.hi < 0.0)


def _rounding(function: Callable[[Array], Array]) -> _Jumping:
    """Floor or ceil, which jump at whole numbers."""

    def rule(a: Interval) -> tuple[Interval, Truth]:
        below, above = np.floor(a.lo), np.ceil(a.hi)
        between = (a.lo > below) & (a.hi < above) & (above == below + 1.0)
        return Interval(function(a.lo), function(a.hi)), between

    return rule


def _compared(
    holds: Callable[[Interval, Interval], Truth], fails: Callable[[Interval, Interval], Truth]
) -> _Jumping:
    """A comparison: 1 where it holds all over the box, 0 where it fails, else a jump."""

    def rule(a: Interval, b: Interval) -> tuple[Interval, Truth]:
        yes, no = holds(a, b), fails(a, b)
        return Interval(np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0)), yes | no

    return rule


def _apart(a: Interval, b: Interval) -> Truth:
    found: Truth = (a.hi < b.lo) | (a.lo > b.hi)
    return found


def _never(a: Interval, b: Interval) -> Truth:
    return np.zeros(np.broadcast_shapes(a.lo.shape, b.lo.shape), dtype=bool)


def _below(a: Interval, b: Interval) -> Truth:
    found: Truth = a.hi < b.lo
    return found


def _arc_tangent_2(y: Interval, x: Interval) -> tuple[Interval, Truth]:
    """The angle of (x, y), which jumps at the cut y = 0, x <= 0."""
    corners = [np.arctan2(v, u) for v in (y.lo, y.hi) for u in (x.lo, x.hi)]
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    continuous = (x.lo > 0.0) | (y.lo > 0.0) | (y.hi < 0.0)
    return _where(continuous, _library(low, high)), continuous


def _logical(function: Callable[..., Array]) -> _Jumping:
    """Not, and, or of truths, which are 0 or 1 where nothing jumped before."""

    def rule(*arguments: Interval) -> tuple[Interval, Truth]:
        settled = np.logical_and.reduce([a.lo == a.hi for a in arguments])
        value = np.where(settled, function(*[a.lo for a in arguments]), 0.0)
        return Interval(value, np.where(settled, value, 1.0)), settled

    return rule


def _if_else_zero(condition: Interval, a: Interval) -> tuple[Interval, Truth]:
    yes, no = condition.lo > 0.0, (condition.lo == 0.0) & (condition.hi == 0.0)
    low = np.where(yes, a.lo, np.where(no, 0.0, np.minimum(a.lo, 0.0)))
    high = np.where(yes, a.hi, np.where(no, 0.0, np.maximum(a.hi, 0.0)))
    return Interval(low, high), yes | no


_exp = _increasing(np.exp)
_log = _increasing(np.log, least=0.0)

_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: add,
    ca.OP_SUB: subtract,
    ca.OP_NEG: lambda a: Interval(-a.hi, -a.lo),
    ca.OP_MUL: multiply,
    ca.OP_DIV: lambda a, b: multiply(a, _reciprocal(b)),
    ca.OP_INV: _reciprocal,
    ca.OP_SQ: square,
    ca.OP_TWICE: lambda a: add(a, a),
    ca.OP_SQRT: root,
    ca.OP_EXP: _exp,
    ca.OP_LOG: _log,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_SIN: _wave(np.sin, np.pi / 2),
    ca.OP_COS: _wave(np.cos, 0.0),
    ca.OP_TAN: _tangent,
    ca.OP_ASIN: _increasing(np.arcsin, -1.0, 1.0),
    ca.OP_ACOS: _arc_cosine,
    ca.OP_ATAN: _increasing(np.arctan),
    ca.OP_SINH: _increasing(np.sinh),
    ca.OP_COSH: _hyperbolic_cosine,
    ca.OP_TANH: _increasing(np.tanh),
    ca.OP_FABS: absolute,
    ca.OP_FMIN: lambda a, b: Interval(np.minimum(a.lo, b.lo), np.minimum(a.hi, b.hi)),
    ca.OP_FMAX: lambda a, b: Interval(np.maximum(a.lo, b.lo), np.maximum(a.hi, b.hi)),
}

_JUMPS: Mapping[int, _Jumping] = {
    ca.OP_SIGN: _sign,
    ca.OP_FLOOR: _rounding(np.floor),
    ca.OP_CEIL: _rounding(np.ceil),
    ca.OP_LT: _compared(_below, lambda a, b: _below(b, a)),
    ca.OP_LE: _compared(_below, lambda a, b: _below(b, a)),
    ca.OP_EQ: _compared(_never, _apart),
    ca.OP_NE: _compared(_apart, _never),
    ca.OP_NOT: _logical(np.logical_not),
    ca.OP_AND: _logical(np.logical_and),
    ca.OP_OR: _logical(np.logical_or),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_ATAN2: _arc_tangent_2,
}
"""A rule's value, and where it is one and the same smooth piece all over the box."""
