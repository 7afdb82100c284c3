"""Evaluate CasADi expressions over boxes, instruction by instruction, with intervals."""

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array, Mask
from phalanx_certify.checker.intervals import (
    Interval,
    UndecidedError,
    absolute,
    add,
    moved,
    multiply,
    outward,
    point,
    root,
    square,
    subtract,
    where,
)


def _reciprocal(a: Interval) -> Interval:
    nonzero = (a.lo > 0.0) | (a.hi < 0.0)
    return where(nonzero, outward(1.0 / a.hi, 1.0 / a.lo))


def _reaches(a: Interval, phase: float) -> Mask:
    """Return whether phase + 2πk may lie in a for some integer k; True in doubt."""
    first, last = (a.lo - phase) / (2 * np.pi), (a.hi - phase) / (2 * np.pi)
    doubt = 1e-9 + 1e-12 * np.maximum(np.abs(first), np.abs(last))
    mask: Mask = ~(np.ceil(first - doubt) > last + doubt)
    return mask


def _wave(function: Callable[[Array], Array], top: float) -> Callable[[Interval], Interval]:
    """Sine or cosine, whose maximum is at `top`."""

    def rule(a: Interval) -> Interval:
        ends = function(a.lo), function(a.hi)
        bounds = moved(np.minimum(*ends), np.maximum(*ends))
        low = np.where(_reaches(a, top + np.pi), -1.0, np.maximum(bounds.lo, -1.0))
        return Interval(low, np.where(_reaches(a, top), 1.0, np.minimum(bounds.hi, 1.0)))

    return rule


def _increasing(
    function: Callable[[Array], Array], least: float = -np.inf, most: float = np.inf
) -> Callable[[Interval], Interval]:
    """A library function that increases on [least, most] and is not defined elsewhere."""
    return lambda a: where((a.lo >= least) & (a.hi <= most), moved(function(a.lo), function(a.hi)))


def _arc_cosine(a: Interval) -> Interval:
    return where((a.lo >= -1.0) & (a.hi <= 1.0), moved(np.arccos(a.hi), np.arccos(a.lo)))


def _tangent(a: Interval) -> Interval:
    pole = _reaches(a, np.pi / 2) | _reaches(a, -np.pi / 2)
    return where(~pole, moved(np.tan(a.lo), np.tan(a.hi)))


def _hyperbolic_cosine(a: Interval) -> Interval:
    size = absolute(a)
    return moved(np.cosh(size.lo), np.cosh(size.hi))


def _power(a: Interval, b: Interval) -> Interval:
    """a to the power b: whole and constant, or of a positive a."""
    if b.lo.ndim or b.lo != b.hi or not float(b.lo).is_integer():
        return _exp(multiply(b, where(a.lo > 0.0, _log(a))))
    n = float(b.lo)
    if n < 0:
        return _reciprocal(_power(a, point(-n)))
    base = absolute(a) if n % 2 == 0 else a
    return moved(base.lo**n, base.hi**n)


_Jumping = Callable[..., tuple[Interval, Mask]]


def _sign(a: Interval) -> tuple[Interval, Mask]:
    # sign(0) is 0, with jumps on both sides.
    return Interval(np.sign(a.lo), np.sign(a.hi)), (a.lo > 0.0) | (a.hi < 0.0)


def _rounding(function: Callable[[Array], Array]) -> _Jumping:
    """Floor or ceil, which jump at whole numbers."""

    def rule(a: Interval) -> tuple[Interval, Mask]:
        below, above = np.floor(a.lo), np.ceil(a.hi)
        between = (a.lo > below) & (a.hi < above) & (above == below + 1.0)
        return Interval(function(a.lo), function(a.hi)), between

    return rule


def _compared(
    holds: Callable[[Interval, Interval], Mask], fails: Callable[[Interval, Interval], Mask]
) -> _Jumping:
    """A comparison: 1 where it holds all over the box, 0 where it fails, else a jump."""

    def rule(a: Interval, b: Interval) -> tuple[Interval, Mask]:
        yes, no = holds(a, b), fails(a, b)
        return Interval(np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0)), yes | no

    return rule


def _differs(a: Interval, b: Interval) -> Mask:
    mask: Mask = (a.hi < b.lo) | (a.lo > b.hi)
    return mask


def _never(a: Interval, b: Interval) -> Mask:
    return np.zeros(np.broadcast_shapes(a.lo.shape, b.lo.shape), dtype=bool)


def _below(a: Interval, b: Interval) -> Mask:
    mask: Mask = a.hi < b.lo
    return mask


def _arc_tangent_2(y: Interval, x: Interval) -> tuple[Interval, Mask]:
    """The angle of (x, y), which jumps at the cut y = 0, x <= 0."""
    corners = [np.arctan2(v, u) for v in (y.lo, y.hi) for u in (x.lo, x.hi)]
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    continuous = (x.lo > 0.0) | (y.lo > 0.0) | (y.hi < 0.0)
    return where(continuous, moved(low, high)), continuous


def _logical(function: Callable[..., Array]) -> _Jumping:
    """Not, and, or of truths, which are 0 or 1 where nothing jumped before."""

    def rule(*arguments: Interval) -> tuple[Interval, Mask]:
        # A condition that is a number has no shape.
        lows = np.broadcast_arrays(*[a.lo for a in arguments])
        highs = np.broadcast_arrays(*[a.hi for a in arguments])
        settled: Mask = np.logical_and.reduce(np.equal(lows, highs))
        value = np.where(settled, function(*lows), 0.0)
        return Interval(value, np.where(settled, value, 1.0)), settled

    return rule


def _if_else_zero(condition: Interval, a: Interval) -> tuple[Interval, Mask]:
    yes, no = condition.lo > 0.0, (condition.lo == 0.0) & (condition.hi == 0.0)
    low = np.where(yes, a.lo, np.where(no, 0.0, np.minimum(a.lo, 0.0)))
    high = np.where(yes, a.hi, np.where(no, 0.0, np.maximum(a.hi, 0.0)))
    return Interval(low, high), yes | no


_exp = _increasing(np.exp)
_log = _increasing(np.log, least=0.0)

RULES: Mapping[int, Callable[..., Interval]] = {
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

JUMPS: Mapping[int, _Jumping] = {
    ca.OP_SIGN: _sign,
    ca.OP_FLOOR: _rounding(np.floor),
    ca.OP_CEIL: _rounding(np.ceil),
    ca.OP_LT: _compared(_below, lambda a, b: _below(b, a)),
    ca.OP_LE: _compared(_below, lambda a, b: _below(b, a)),
    ca.OP_EQ: _compared(_never, _differs),
    ca.OP_NE: _compared(_differs, _never),
    ca.OP_NOT: _logical(np.logical_not),
    ca.OP_AND: _logical(np.logical_and),
    ca.OP_OR: _logical(np.logical_or),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_ATAN2: _arc_tangent_2,
}
"""The value of each rule, and where it is one smooth piece over the whole box."""


class IntervalFunction:
    """Expressions of vectors, bounded over boxes by one pass through CasADi's instructions.

    Constants in an expression are taken as CasADi folded them, in float64.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Column inputs, shape (n,) each, made of symbols; outputs of any shape.

        Raises UndecidedError, naming an operation for which there is no rule.
        """
        flat = [ca.densify(ca.vec(output)) for output in outputs]
        self._sizes = [output.numel() for output in flat]
        f = self._f = ca.Function("f", [ca.vec(i) for i in inputs], flat, {"cse": True})
        self._program = [
            (f.instruction_id(k), f.instruction_input(k), f.instruction_output(k))
            for k in range(f.n_instructions())
        ]
        rules = {*RULES, *JUMPS, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
        for op, _, _ in self._program:
            if op not in rules:
                raise UndecidedError(f"no interval rule for the operation {_name(op)!r}")

    def __call__(self, *inputs: Interval) -> tuple[list[Interval], Mask]:
        """Bounds of each output, shapes (size, s), over s boxes, inputs (n, s) each.

        Also returns whether nothing in them can jump there, shape (s,). A sign, a comparison or a
        rounding that is not constant over a box is a jump, even if only in a derivative (a kink).
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
                elif op in RULES:
                    work[targets[0]] = RULES[op](*[work[s] for s in sources])
                else:
                    work[targets[0]], constant = JUMPS[op](*[work[s] for s in sources])
                    smooth &= constant
        return results, smooth


def _name(op: int) -> str:
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    return names.get(op, str(op)).removeprefix("OP_").lower()
