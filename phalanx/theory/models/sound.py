"""Whether a dynamics returns what a dynamics must: names, shapes and weights, asked once."""

import math
from typing import Any

import casadi as ca

from phalanx.theory.expressions.asked import (
    MistakenMethodError,
    ask,
    ask_expression,
    require_expression,
)
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, constant_polytope


def require_sound(dynamics: Dynamics) -> None:
    """Ask a dynamics for all its expressions.

    Raises:
        MistakenMethodError: a shape or a name is wrong, a weight is not above 0, or it failed.
    """
    n, m = (_count(dynamics, field) for field in ("states", "inputs"))
    for field, count in (("state_units", n), ("input_units", m)):
        found = getattr(dynamics, field, None)
        if found is not None and (not isinstance(found, tuple | list) or len(found) != count):
            raise MistakenMethodError(dynamics, field, f"a tuple of {count} units", repr(found))
    x = ca.SX.sym("x", n)
    ask_expression(dynamics, "drift", [(n,)], x, symbols=[x])
    ask_expression(dynamics, "actuation", [(n, m)], x, symbols=[x])
    ask_expression(dynamics, "position", [(2,), (3,)], x, symbols=[x])
    _require_polytope(dynamics, x, m)
    _require_metric(dynamics, m)


def _count(dynamics: Dynamics, field: str) -> int:
    expected = "a tuple of different names"
    names: Any = getattr(dynamics, field)
    named = isinstance(names, tuple | list) and all(isinstance(name, str) for name in names)
    if not named or not names or len(set(names)) < len(names):
        raise MistakenMethodError(dynamics, field, expected, repr(names))
    return len(names)


def _require_polytope(dynamics: Dynamics, x: ca.SX, m: int) -> None:
    expected = f"A(x) of shape (r, {m}) and b(x) of shape (r,)"
    found = ask(dynamics, "input_polytope", expected, x)
    if not isinstance(found, tuple | list) or len(found) != 2:
        got = f"{len(found)} values" if isinstance(found, tuple | list) else type(found).__name__
        raise MistakenMethodError(dynamics, "input_polytope", expected, got)
    A, b = found
    rows = int(getattr(A, "shape", (0,))[0])
    A = require_expression(dynamics, "input_polytope", [(rows, m)], A, symbols=[x])
    b = require_expression(dynamics, "input_polytope", [(rows,)], b, symbols=[x])
    try:
        constant_polytope(A, b)
    except EmptyPolytopeError as error:
        expected = "a compact set that is not empty"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_metric(dynamics: Dynamics, m: int) -> None:
    expected = f"{m} weights above 0"
    weights = ask(dynamics, "input_metric", expected)
    try:
        right = len(weights) == m and all(0.0 < float(w) < math.inf for w in weights)
    except (TypeError, ValueError):
        right = False
    if not right:
        raise MistakenMethodError(dynamics, "input_metric", expected, repr(weights))
