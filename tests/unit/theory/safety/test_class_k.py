"""Functions that are accepted as class K, and others that are not."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import pytest

from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.safety.class_k import Linear, Power, require_class_k


@dataclass(frozen=True)
class Own:
    """α as a user writes it."""

    function: Callable[[ca.SX], ca.SX]

    def value(self, s: ca.SX) -> ca.SX:
        return self.function(s)


@pytest.mark.parametrize(
    "alpha",
    [
        Linear(2.0),
        Power(0.3, 1.0),
        Power(2.0, 1.5),
        Power(1.0, 3.0),
        Own(lambda s: s + s**3),
        Own(lambda s: ca.if_else(s > 0.3, 2 * s - 0.3, s)),
        Own(lambda s: ca.fmax(s, 2 * s)),
        Own(lambda s: ca.sinh(s)),
        Own(lambda s: ca.sign(s) * ca.sqrt(ca.fabs(s))),
    ],
)
def test_a_class_k_function_may_have_kinks_and_any_steepness(alpha):
    require_class_k(alpha)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda s: s + 1e-6, r"α\(0\) = 0"),
        (lambda s: -s, r"α\(-1e\+09\) < α"),
        (lambda s: ca.fmax(s - 1, 0) + ca.fmin(s + 1, 0), r"α\(.*\) < α"),
        (lambda s: ca.fmin(ca.fmax(s, -1), 1), r"α\(-1e\+09\) < α"),
        (lambda s: s - 2 * ca.fmax(s - 1e6, 0), r"α\(1e\+06\) < α"),
        (lambda s: s - 2e-8 * ca.tanh(1e8 * s), r"α\(-.*e-0\d\) < α"),
        (lambda s: s + ca.if_else(s > 0.3, 1, 0), "without a jump at 0.3"),
        (lambda s: s - ca.if_else(s > 0.3, 0.1, 0), "without a jump at 0.3"),
        (lambda s: s + 1e-6 * (s > 0.37), "without a jump at 0.37"),
        (lambda s: s + (s >= 123456.7), "without a jump at 123457"),
        (lambda s: s + 0.5 * ca.sign(s), "without a jump at 0"),
        (lambda s: s + ca.floor(s), "without a jump"),
        (lambda s: ca.sqrt(s), "α"),
    ],
)
def test_another_function_is_refused_with_its_place(function, expected):
    with pytest.raises(MistakenMethodError, match=expected):
        require_class_k(Own(function))


def test_an_operation_whose_jumps_are_not_known_is_refused_by_its_name():
    with pytest.raises(MistakenMethodError, match="fmod"):
        require_class_k(Own(lambda s: s + ca.fmod(s, 3.0)))
