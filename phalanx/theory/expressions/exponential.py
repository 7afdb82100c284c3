"""exp, log, powers and hyperbolic functions of exact operations only: the same bits on any CPU.

libm has a variant for each kind of CPU, and variants differ in the last bit. IEEE 754 fixes
+ - * / sqrt, floor, min and max. Algorithms and coefficients are those of fdlibm. Two uses of libm
remain, both exact: powers of two with integer exponents; pow and log with a result of 0, 1, ±∞ or
NaN.

Every function takes CasADi scalars and vectors, SX, MX or DM. CasADi must not simplify symbols
meanwhile (portable.as_written): (a + b) - a is not b here, it is b rounded.
"""

from typing import Any

import casadi as ca

Expression = Any
"""SX, MX or DM, for which CasADi has no common type."""

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_INVERSE_LN2 = 1.44269504088896338700e00
_OVER = 746.0
"""exp(746) is infinite, exp(-746) zero."""
_EXP = (
    4.13813679705723846039e-08,
    -1.65339022054652515390e-06,
    6.61375632143793436117e-05,
    -2.77777777770155933842e-03,
    1.66666666666666019037e-01,
)
_LOG = (
    1.479819860511658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)


def polynomial(coefficients: tuple[float, ...], x: Expression) -> Expression:
    """Evaluate a polynomial by Horner's rule; the highest power's coefficient comes first."""
    total = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * x + coefficient
    return total


def exp(x: Expression) -> Expression:
    """e^x, to 1 ulp."""
    # sign(x) min(|x|, 746): unlike min and max alone this keeps NaN.
    x = ca.sign(x) * ca.fmin(ca.fabs(x), _OVER)
    k = ca.floor(x * _INVERSE_LN2 + 0.5)
    high, low = x - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    t = r * r
    c = r - polynomial(_EXP, t) * t
    y = 1.0 - ((low - r * c / (2.0 - c)) - high)
    # 2^1024 is infinite, y 2^1024 need not be.
    return (y + y) * _power_of_two(k - 1.0)


def log(x: Expression) -> Expression:
    """ln x, to 1 ulp."""
    k, m = _exponent(x)
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    half = 0.5 * f * f
    value = s * (half + polynomial(_LOG, z) * z) + k * _LN2_LOW - half + f + k * _LN2_HIGH
    return ca.if_else(_positive(x), value, ca.log(x))


def power(x: Expression, y: Expression) -> Expression:
    """x^y: by products and a root for multiples of ½ up to 4, else to 2 ulp for usual sizes."""
    if y.is_constant() and y.is_scalar() and _is_short(float(y)):
        return _short_power(x, float(y))
    size = ca.fabs(x)
    high, low = _log_in_two(size)
    exponent = y * high
    rest = _product_error(y, high, exponent) + y * low
    rest = ca.if_else(ca.fabs(exponent) < _OVER, rest, 0.0)
    odd = y - 2.0 * ca.floor(0.5 * y)
    signed = ca.if_else(x < 0.0, 1.0 - 2.0 * odd, 1.0) * exp(exponent) * (1.0 + rest)
    real = ca.logic_or(x > 0.0, y == ca.floor(y))
    usual = ca.logic_and(ca.logic_and(_positive(size), ca.fabs(y) < ca.inf), real)
    return ca.if_else(usual, signed, x**y)


def expm1(x: Expression) -> Expression:
    """e^x - 1, to a few ulp."""
    u = exp(x)
    near = (u - 1.0) * x / log(u)
    return ca.if_else(u == 1.0, x, ca.if_else(ca.fabs(x) < 1.0, near, u - 1.0))


def log1p(x: Expression) -> Expression:
    """ln(1 + x), to a few ulp."""
    u = 1.0 + x
    near = log(u) * (x / (u - 1.0))
    return ca.if_else(u == 1.0, x, ca.if_else(ca.fabs(x) < 1.0, near, log(u)))


def sinh(x: Expression) -> Expression:
    """sinh x, to a few ulp."""
    size = ca.fabs(x)
    t = expm1(size)
    half = exp(0.5 * size)
    usual = 0.5 * (t + t / (t + 1.0))
    return ca.sign(x) * ca.if_else(size < 700.0, usual, 0.5 * half * half)


def cosh(x: Expression) -> Expression:
    """cosh x, to a few ulp."""
    size = ca.fabs(x)
    u, half = exp(size), exp(0.5 * size)
    return ca.if_else(size < 700.0, 0.5 * (u + 1.0 / u), 0.5 * half * half)


def tanh(x: Expression) -> Expression:
    """tanh x, to a few ulp."""
    t = expm1(2.0 * ca.fmin(ca.fabs(x), 30.0))
    return ca.sign(x) * (t / (t + 2.0))


def asinh(x: Expression) -> Expression:
    """asinh x, to a few ulp."""
    size = ca.fabs(x)
    usual = log1p(size + size * size / (1.0 + ca.sqrt(1.0 + size * size)))
    return ca.sign(x) * ca.if_else(size < 1e150, usual, (log(size) + _LN2_LOW) + _LN2_HIGH)


def acosh(x: Expression) -> Expression:
    """acosh x, to a few ulp."""
    t = x - 1.0
    usual = log1p(t + ca.sqrt(t + t + t * t))
    return ca.if_else(x < 1e150, usual, (log(x) + _LN2_LOW) + _LN2_HIGH)


def atanh(x: Expression) -> Expression:
    """atanh x, to a few ulp."""
    size = ca.fabs(x)
    return ca.sign(x) * (0.5 * log1p(2.0 * size / (1.0 - size)))


def hypot(x: Expression, y: Expression) -> Expression:
    """√(x² + y²), to 2 ulp and without overflow on the way."""
    x, y = ca.fabs(x), ca.fabs(y)
    large, small = ca.fmax(x, y), ca.fmin(x, y)
    ratio = ca.if_else(small < large, small / large, 1.0)
    total = x + y  # NaN if one of them is
    return ca.if_else(total < ca.inf, large * ca.sqrt(1.0 + ratio * ratio), total)


def split(x: Expression) -> tuple[Expression, Expression]:
    """Split x exactly into a sum of two numbers of 26 bits (Veltkamp)."""
    c = 134217729.0 * x
    high = c - (c - x)
    return high, x - high


def _product_error(a: Expression, b: Expression, product: Expression) -> Expression:
    """a b - product, exactly (Dekker)."""
    (a1, a2), (b1, b2) = split(a), split(b)
    return a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2)


def _positive(x: Expression) -> Expression:
    return ca.logic_and(x > 0.0, x < ca.inf)


def _power_of_two(k: Expression) -> Expression:
    """2^k for an integer k, which every libm computes exactly."""
    return ca.power(2.0, k)


def _exponent(x: Expression) -> tuple[Expression, Expression]:
    """An integer k, and m in [√½, √2), with x = 2^k m exactly; for 0 < x < ∞."""
    # An error of libm's logarithm may change k by one; the last line corrects that.
    k = ca.floor(ca.log(x) * _INVERSE_LN2 + 0.5)
    half = ca.floor(0.5 * k)
    m = x * _power_of_two(-half) * _power_of_two(half - k)  # 2^-k may be infinite
    up, down = m >= 1.4142135623730951, m < 0.7071067811865476
    return k + up - down, m * (1.0 - 0.5 * up + down)


def _log_in_two(x: Expression) -> tuple[Expression, Expression]:
    """ln x as a sum of two numbers, to about 2^-61; for 0 < x < ∞."""
    k, m = _exponent(x)
    f = m - 1.0
    d = f + 2.0
    s = f / d
    product = s * d
    remainder = ((f - product) - _product_error(s, d, product)) - s * (f - (d - 2.0))
    z = s * s
    small = 2.0 * (remainder / d) + s * (polynomial(_LOG, z) * z) + k * _LN2_LOW
    large, twice = k * _LN2_HIGH, s + s
    total = large + twice
    small = (twice - (total - large)) + small
    high = total + small
    return high, small - (high - total)


def _is_short(y: float) -> bool:
    return abs(y) <= 4.0 and (2.0 * y).is_integer()


def _short_power(x: Expression, y: float) -> Expression:
    """x^y by repeated multiplication, and a square root if y is not an integer."""
    result, base, bits = None, x, int(abs(y))
    while bits:
        if bits % 2:
            result = base if result is None else result * base
        base, bits = base * base, bits // 2
    if not y.is_integer():
        result = ca.sqrt(x) if result is None else result * ca.sqrt(x)
    result = x**0 if result is None else result
    return 1.0 / result if y < 0.0 else result
