"""What a class of a user's own returns when it is asked: one line says where it is mistaken."""

from collections.abc import Sequence
from typing import Any

import casadi as ca

Shape = tuple[int, ...]


class MistakenMethodError(ValueError):
    """A method returned what nobody can use; the message names class, method, expected and got."""

    def __init__(self, of: object, method: str, expected: str, got: str) -> None:
        self.expected = f"{type(of).__name__}.{method}: expected {expected}"
        """The message without what was got."""
        self.got = got
        super().__init__(f"{self.expected}, got {got}")


def ask(of: object, method: str, expected: str, *arguments: Any) -> Any:
    """Call a method of a user's class.

    Raises:
        MistakenMethodError: it raised anything.
    """
    try:
        return getattr(of, method)(*arguments)
    except Exception as error:  # it may raise anything
        raise MistakenMethodError(of, method, expected, in_words(error)) from error


def in_words(error: Exception) -> str:
    """An error in one line."""
    # CasADi's last line says what was wrong, those before it where in CasADi.
    lines = str(error).strip().splitlines() or ["no reason given"]
    return f"{type(error).__name__}: {lines[-1]}"


def ask_expression(
    of: object,
    method: str,
    shapes: Sequence[Shape],
    *arguments: Any,
    symbols: Sequence[ca.SX],
) -> ca.SX:
    """Call a method that returns a CasADi expression.

    Args:
        of: whose method it is.
        method: its name.
        shapes: those allowed: () for a scalar, (n,) for a column, (n, m) for a matrix.
        arguments: the method's.
        symbols: what the expression may be of.

    Raises:
        MistakenMethodError: it raised anything, or returned something else.
    """
    expected = " or ".join(map(_in_words, shapes))
    return require_expression(
        of, method, shapes, ask(of, method, expected, *arguments), symbols=symbols
    )


def require_expression(
    of: object, method: str, shapes: Sequence[Shape], value: Any, *, symbols: Sequence[ca.SX]
) -> ca.SX:
    """The same of a value that a method has returned, or a part of it."""
    expected = " or ".join(map(_in_words, shapes))
    try:
        found = ca.SX(value)
    except Exception as error:  # CasADi's, for whatever it cannot take
        got = "None" if value is None else f"a {type(value).__name__} that is no expression"
        raise MistakenMethodError(of, method, expected, got) from error
    if found.shape not in [(*shape, 1, 1)[:2] for shape in shapes]:
        got = _in_words(found.shape if found.shape[1] != 1 else found.shape[:1])
        raise MistakenMethodError(of, method, expected, got)
    known = {symbol.element_hash() for part in symbols for symbol in ca.symvar(part)}
    for symbol in ca.symvar(found):
        if symbol.element_hash() not in known:
            raise MistakenMethodError(
                of, method, "an expression of its arguments alone", f"one of {symbol} too"
            )
    return found


def _in_words(shape: Shape) -> str:
    return f"shape {shape}" if shape else "a scalar"
