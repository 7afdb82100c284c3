"""Terms of one argument alone are evaluated once, and the whole expression is unchanged."""

import casadi as ca
import numpy as np

from phalanx.theory.expressions.portable import factor_out


def test_what_is_taken_out_and_what_is_left_make_the_expression_again():
    a, b, number = ca.SX.sym("a", 2), ca.SX.sym("b"), ca.SX.sym("number")
    whole = ca.vertcat(ca.sin(ca.exp(a[0])) * b, ca.cos(a[1] + b) + ca.sqrt(number), ca.exp(number))
    parts, symbols, rest = factor_out([a, b], number, whole)
    # exp and its sine are of a alone; cos(a + b) is of both, exp(number) of neither.
    assert [part.numel() for part in parts] == [2, 0]
    assert [symbol.numel() for symbol in symbols] == [2, 0]
    first = ca.Function("first", [a], [parts[0]])
    second = ca.Function("second", [a, b, number, symbols[0]], [rest])
    expected = ca.Function("whole", [a, b, number], [whole])
    for values in np.random.default_rng(3).uniform(0.1, 2.0, (20, 4)):
        given = values[:2], values[2], values[3]
        assert np.array_equal(second(*given, first(values[:2])), expected(*given))
