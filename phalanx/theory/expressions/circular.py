"""sin, cos and their inverses of exact operations only: the same bits on any CPU.

Algorithms are fdlibm's. Arguments are SX or DM; SX must not simplify (portable.as_written).
"""

import math

import casadi as ca

from phalanx.theory.expressions.exponential import Expression, polynomial, split

_PERIODS = 65536.0 * 2.0 * math.pi
_INVERSE = 6.36619772367581382433e-01
# π/2 in three parts: 33 bits, 33 bits, the rest. n times one of the first two is exact for
# integers n below 2^20.
_PART_1 = 1.57079632673412561417e00
_PART_2 = 6.07710050630396597660e-11
_REST = 2.02226624879595063154e-21
_SIN = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
)
_SIN_1 = -1.66666666666666324348e-01
_COS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
_ATAN = (
    1.62858201153657823623e-02,
    -3.65315727442169155270e-02,
    4.97687799461593236017e-02,
    -5.83357013379057348645e-02,
    6.66107313738753120669e-02,
    -7.69187620504482999495e-02,
    9.09088713343650656196e-02,
    -1.11111104054623557880e-01,
    1.42857142725034663711e-01,
    -1.99999999998764832476e-01,
    3.33333333333329318027e-01,
)
# atan of 0, 1/2, 1, 3/2 and ∞, each as a sum of two.
_CORNERS = (
    (0.0, 0.0),
    (4.63647609000806093515e-01, 2.26987774529616870924e-17),
    (7.85398163397448278999e-01, 3.06161699786838301793e-17),
    (9.82793723247329054082e-01, 1.39033110312309984516e-17),
    (1.57079632679489655800e00, 6.12323399573676603587e-17),
)
_QUARTER = _CORNERS[-1]
_ASIN_OVER = (
    3.47933107596021167570e-05,
    7.91534994289814532176e-04,
    -4.00555345006794114027e-02,
    2.01212532134862925881e-01,
    -3.25565818622400915405e-01,
    1.66666666666666657415e-01,
)
_ASIN_UNDER = (
    7.70381505559019352791e-02,
    -6.88283971605453293030e-01,
    2.02094576023350569471e00,
    -2.40339491173441421878e00,
    1.0,
)


def sin(x: Expression) -> Expression:
    """sin x, to 1 ulp up to |x| = 4e5; beyond, the sine of a number half an ulp from x."""
    return sin_and_cos(x)[0]


def cos(x: Expression) -> Expression:
    """cos x, as exact as sin."""
    return sin_and_cos(x)[1]


def tan(x: Expression) -> Expression:
    """tan x, to 2 ulp."""
    s, c = sin_and_cos(x)
    return s / c


def sin_and_cos(x: Expression) -> tuple[Expression, Expression]:
    """sin x and cos x, which share everything but their last step."""
    quarters, r, rest = _reduced(ca.fmod(x, _PERIODS))
    s, c = _kernels(r, rest)
    halves = ca.floor(0.5 * quarters)
    odd = quarters - 2.0 * halves
    even = 1.0 - odd
    sign = 1.0 - 2.0 * (halves - 2.0 * ca.floor(0.5 * halves))
    s, c = sign * s, sign * c
    return even * s + odd * c, even * c - odd * s


def _reduced(x: Expression) -> tuple[Expression, Expression, Expression]:
    """An integer n, and r + rest in ±π/4, with x = n π/2 + r + rest."""
    n = ca.floor(x * _INVERSE + 0.5)
    near = x - n * _PART_1
    step = n * _PART_2
    nearer = near - step
    small = n * _REST - ((near - nearer) - step)
    r = nearer - small
    return n, r, (nearer - r) - small


def _kernels(r: Expression, rest: Expression) -> tuple[Expression, Expression]:
    """sin and cos of r + rest in ±π/4."""
    z = r * r
    v = z * r
    s = r - ((z * (0.5 * rest - v * polynomial(_SIN, z)) - rest) - v * _SIN_1)
    half = 0.5 * z
    w = 1.0 - half
    c = w + (((1.0 - w) - half) + (z * (polynomial(_COS, z) * z) - r * rest))
    return s, c


def atan(x: Expression) -> Expression:
    """atan x, to 1 ulp."""
    size = ca.fabs(x)
    # The corner nearest to |x|: c = 0, 1/2, 1, 3/2 with (|x| - c) / (1 + c |x|), or -1 / |x|.
    above = [size >= 0.4375, size >= 0.6875, size >= 1.1875, size >= 2.4375]
    c = 0.5 * (above[0] + above[1] + above[2])
    t = ca.if_else(above[3], -1.0 / size, (size - c) / (1.0 + c * size))
    high, low = ca.DM(0.0), ca.DM(0.0)
    for reached, (here, rest), (below, rest_below) in zip(
        above, _CORNERS[1:], _CORNERS, strict=False
    ):
        # Sums of corners would round: take the last one reached.
        high = ca.if_else(reached, here, high if below else 0.0)
        low = ca.if_else(reached, rest, low if below else rest_below)
    angle = high - ((t * (polynomial(_ATAN, t * t) * (t * t)) - low) - t)
    return ca.if_else(x < 0.0, -angle, angle)


def atan2(y: Expression, x: Expression) -> Expression:
    """The angle of (x, y), to 2 ulp."""
    across, along = ca.fabs(y), ca.fabs(x)
    # ∞/∞ counts as the diagonal, 0/0 as the axis.
    both = ca.logic_and(across == ca.inf, along == ca.inf)
    none = ca.logic_and(across == 0.0, along == 0.0)
    first = atan(ca.if_else(both, 1.0, ca.if_else(none, 0.0, across / along)))
    backward = ca.copysign(1.0, x) < 0.0
    angle = ca.if_else(backward, 2.0 * _QUARTER[0] - (first - 2.0 * _QUARTER[1]), first)
    return ca.if_else(ca.copysign(1.0, y) < 0.0, -angle, angle)


def asin(x: Expression) -> Expression:
    """asin x, to 1 ulp."""
    size = ca.fabs(x)
    inner = size + size * _asin_ratio(size * size)
    z, s, head, tail = _half_angle(size)
    ratio = _asin_ratio(z)
    p = 2.0 * s * ratio - (_QUARTER[1] - 2.0 * tail)
    outer = 0.5 * _QUARTER[0] - (p - (0.5 * _QUARTER[0] - 2.0 * head))
    angle = ca.if_else(size < 0.5, inner, outer)
    return ca.if_else(x < 0.0, -angle, angle)


def acos(x: Expression) -> Expression:
    """acos x, to 1 ulp."""
    size = ca.fabs(x)
    inner = _QUARTER[0] - (x - (_QUARTER[1] - x * _asin_ratio(x * x)))
    z, s, head, tail = _half_angle(size)
    ratio = _asin_ratio(z)
    positive = 2.0 * (head + (ratio * s + tail))
    negative = 2.0 * (_QUARTER[0] - (s + (ratio * s - _QUARTER[1])))
    return ca.if_else(size < 0.5, inner, ca.if_else(x < 0.0, negative, positive))


def _asin_ratio(z: Expression) -> Expression:
    return z * polynomial(_ASIN_OVER, z) / polynomial(_ASIN_UNDER, z)


def _half_angle(size: Expression) -> tuple[Expression, Expression, Expression, Expression]:
    """z = (1 - size) / 2, its root s, and s once more as the sum of two numbers."""
    z = 0.5 * (1.0 - size)
    s = ca.sqrt(z)
    head, _ = split(s)
    # For size = 1 the root is zero, and so is its tail.
    tail = ca.if_else(s > 0.0, (z - head * head) / (s + head), 0.0)
    return z, s, head, tail
