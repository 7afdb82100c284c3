"""Compiled functions against Python's math, and their bits without the CPU's fused operations."""

import hashlib
import json
import math
import os
import subprocess
import sys
import tracemalloc
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.expressions.circular import cos
from phalanx.theory.expressions.compiled import CompiledFunction, MappedFunction
from phalanx.theory.expressions.portable import portable_function, portable_value

WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
"""What makes libm choose as it would on a CPU of before 2013."""


def compiled(function, arguments=1):
    x = ca.SX.sym("x", arguments)
    evaluate = CompiledFunction([x], [function(*ca.vertsplit(x))])
    return lambda *values: float(evaluate(np.array(values))[0][0])


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


# How many units in the last place it may be off, and from where to where.
ONE = {
    "sin": (2, -1e5, 1e5),
    "cos": (2, -1e5, 1e5),
    "tan": (3, -1e5, 1e5),
    "asin": (2, -1, 1),
    "acos": (2, -1, 1),
    "atan": (2, -1e300, 1e300),
    "exp": (2, -700, 709.7),
    "log": (2, 1e-307, 1e308),
    "expm1": (3, -50, 700),
    "log1p": (3, -0.999, 1e300),
    "sinh": (4, -710, 710),
    "cosh": (3, -710, 710),
    "tanh": (4, -40, 40),
    "asinh": (4, -1e300, 1e300),
    "acosh": (4, 1, 1e300),
    "atanh": (4, -0.999999, 0.999999),
}
TWO = {"atan2": (ca.atan2, math.atan2, 3), "hypot": (ca.hypot, math.hypot, 3)}
SPECIAL = [0.0, 1.0, -1.0, 0.5, -2.0, 3.0, 1e300, math.inf, -math.inf, math.nan]


@cache
def functions() -> dict:
    """Every function of one argument, compiled."""
    return {name: compiled(getattr(ca, name)) for name in ONE}


@cache
def power():
    """x to the power of y, compiled."""
    return compiled(lambda x, y: x**y, 2)


def off(value: float, right: float) -> float:
    """Difference of two numbers in units in the last place."""
    return abs(value - right) / math.ulp(right)


def by_libm(function, *values: float) -> float:
    """The value as C computes it, where Python raises."""
    with np.errstate(all="ignore"):
        return float(function(*[np.array([value]) for value in values])[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE)
def test_a_function_is_right_to_a_few_units_in_the_last_place(name):
    most, low, high = ONE[name]

    @given(x=numbers(low, high))
    def check(x):
        assert off(functions()[name](x), getattr(math, name)(x)) <= most

    check()


@given(quarters=st.integers(-60_000, 60_000), ulps=st.integers(-3, 3))
def test_sine_and_cosine_are_right_next_to_their_zeros(quarters, ulps):
    x = quarters * math.pi / 2
    x += ulps * math.ulp(x)
    for name in ("sin", "cos"):
        assert off(functions()[name](x), getattr(math, name)(x)) <= 2


@pytest.mark.parametrize("name", TWO)
def test_a_function_of_two_is_right_on_every_side(name):
    function, right, most = TWO[name]
    evaluate = compiled(function, 2)

    @given(y=numbers(-1e6, 1e6), x=numbers(-1e6, 1e6))
    def check(y, x):
        assert off(evaluate(y, x), right(y, x)) <= most

    check()


@given(x=numbers(1e-6, 1e6), y=numbers(-20, 20))
def test_a_power_is_right_for_any_exponent(x, y):
    assert off(power()(x, y), math.pow(x, y)) <= 3


@pytest.mark.parametrize("exponent", [-2.5, -1.0, 0.5, 1.5, 2.5, 3.5, 7.5, 1 / 3, 0.9])
def test_a_constant_power_is_right(exponent):
    evaluate = compiled(lambda x: x**exponent)

    @given(x=numbers(1e-6, 1e6))
    def check(x):
        assert off(evaluate(x), math.pow(x, exponent)) <= 3

    check()


@pytest.mark.parametrize("name", ONE)
@pytest.mark.parametrize("x", SPECIAL)
def test_what_is_infinite_nought_or_not_a_number_comes_out_as_from_libm(name, x):
    of_numpy = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "asinh": "arcsinh"}
    of_numpy |= {"acosh": "arccosh", "atanh": "arctanh"}
    if name in ("sin", "cos", "tan") and x == 1e300:
        pytest.skip("an argument half a unit away has any sine")
    right = by_libm(getattr(np, of_numpy.get(name, name)), x)
    assert functions()[name](x) == pytest.approx(right, rel=1e-15, abs=0.0, nan_ok=True)


@pytest.mark.parametrize("x", [*SPECIAL, -0.5, -3.0])
@pytest.mark.parametrize("y", [*SPECIAL, -0.5, -3.0])
def test_special_powers_and_angles_come_out_as_from_libm(x, y):
    near = {"rel": 1e-15, "abs": 0.0, "nan_ok": True}
    assert power()(x, y) == pytest.approx(by_libm(np.power, x, y), **near)
    angle = compiled(ca.atan2, 2)
    assert angle(y, x) == pytest.approx(by_libm(np.arctan2, y, x), **near)


@pytest.mark.parametrize("k", [-1074, -1073, -1023, -1022, -1, 0, 1, 1023])
def test_the_exponential_reaches_the_ends_of_the_range(k):
    x = k * math.log(2)
    assert functions()["exp"](x) == pytest.approx(math.exp(x), rel=1e-13, abs=5e-324)
    assert functions()["log"](2.0**k) == pytest.approx(x, rel=1e-15)


def test_an_expression_without_them_is_left_alone():
    x = ca.SX.sym("x", 2)
    function = portable_function([x], ca.sqrt(ca.sumsqr(x)) / (1 + x[0]))
    assert function.n_instructions() < 15


def test_casadi_simplifies_as_before_once_a_function_is_compiled():
    compiled(lambda v: ca.exp(ca.sin(v)) ** 1.7)
    x = ca.SX.sym("x")
    assert ((x + 1.0) - x).is_constant()


def test_a_number_has_the_bits_of_its_expression():
    for angle in np.linspace(-7.0, 7.0, 50).tolist():
        assert portable_value(cos, angle) == functions()["cos"](angle)


@pytest.mark.slow
def test_many_states_take_no_more_memory_than_a_few_and_give_the_same_bits() -> None:
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    function = MappedFunction([a, b], [ca.sin(a) * b])
    values = np.random.default_rng(1).normal(size=(400, 50))
    rows = np.random.default_rng(2).integers(0, 50, size=(5000, 2))
    tracemalloc.start()
    try:
        values_of_rows = function(values, rows)
        size, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert size - values_of_rows.nbytes < 8e6
    assert peak < 3 * values_of_rows.nbytes
    for state in (0, 25, 26, 399):
        assert np.array_equal(values_of_rows[state], function(values[state], rows))


@pytest.mark.slow
def test_bits_are_those_of_a_cpu_without_fused_operations():
    here, there = digests(), digests_elsewhere()
    if here["libm"] == there["libm"]:
        pytest.skip("this libm has one variant on this CPU")
    assert here["ours"] == there["ours"]


def digests() -> dict[str, str]:
    """A hash over many values of every function, and of libm's own."""
    return {
        "ours": digest(functions(), power()),
        "libm": digest({name: getattr(math, name) for name in ONE}, math.pow),
    }


def digest(functions, power) -> str:
    rng, sha = np.random.default_rng(7), hashlib.sha256()
    for name, (_, low, high) in ONE.items():
        for value in rng.uniform(max(low, -3.0), min(high, 3.0), 2000).tolist():
            sha.update(np.float64(functions[name](value)).tobytes())
    for base, exponent in rng.uniform(0.1, 5.0, (2000, 2)).tolist():
        sha.update(np.float64(power(base, exponent)).tobytes())
    return sha.hexdigest()


def digests_elsewhere() -> dict[str, str]:
    """The same from a process of its own, whose libm may not use FMA."""
    program = "import json, test_portable; print(json.dumps(test_portable.digests()))"
    answer = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parent,
        env={**os.environ, **WITHOUT_FMA},
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(json.loads(answer.stdout))
