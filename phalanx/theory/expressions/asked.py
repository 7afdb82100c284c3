"""What a class of a user's own returns when it is asked: one line says where it is mistaken."""

import contextlib
import inspect
import traceback
from collections.abc import Sequence
from pathlib import Path
from threading import get_ident
from typing import Any

import casadi as ca
from numpy.typing import NDArray

Shape = tuple[int, ...]

questions: dict[int, object] = {}
"""By thread, the question that a user's method is answering now; each is another object."""


class EndlessLoopError(BaseException):
    """Raised in a user's method that does not return; what it catches itself must not hold this."""

    def __str__(self) -> str:
        return "an endless loop, or too slow"


class MistakenMethodError(ValueError):
    """A method returned what nobody can use; the message names class, method, expected and got."""

    def __init__(
        self,
        of: object,
        method: str,
        expected: str,
        got: str,
        error: BaseException | None = None,
        agent: str = "",
    ) -> None:
        """error: what the method raised, if it did not return. agent: for whom it was asked."""
        self.agent = agent
        self._method, self._expected = f"{type(of).__name__}.{method}", expected
        self._got, self._error = got, error
        self.expected = f"{self._method}: expected {expected}{agent and f' for agent {agent}'}"
        """The message without what was got."""
        place = _place(of, method, error)
        self._place = f" ({place})" if place else ""
        self.got = got + self._place
        super().__init__(f"{self.expected}, got {self.got}")

    def told(self, whom: str) -> str:
        """The message in a run: what the method did for an agent, a message, a pair."""
        match self._error:
            case None:
                did = f"returned {self._got} for {whom}: expected {self._expected}"
            case EndlessLoopError():
                did = f"has not returned for {whom}: {self._got}"
            case _:
                did = f"raised {self._got} for {whom}"
        return f"{self._method} {did}{self._place}"


def ask(of: object, method: str, expected: str, *arguments: Any, agent: str = "") -> Any:
    """Call a method of a user's class, for an agent if there is one.

    Raises:
        MistakenMethodError: it raised anything, or does not return.
    """
    thread = get_ident()
    questions[thread] = object()
    try:
        return getattr(of, method)(*arguments)
    except (Exception, EndlessLoopError) as error:  # it may raise anything
        raise MistakenMethodError(of, method, expected, in_words(error), error, agent) from error
    finally:
        questions.pop(thread, None)


def in_words(error: BaseException) -> str:
    """An error in one line."""
    if isinstance(error, EndlessLoopError):
        return str(error)
    # CasADi's last line says what was wrong, those before it where in CasADi.
    lines = str(error).strip().splitlines() or ["no reason given"]
    return f"{type(error).__name__}: {lines[-1]}"


def in_short(value: NDArray[Any]) -> str:
    """The first numbers of an array."""
    shown = ", ".join(f"{number:.4g}" for number in value.ravel()[:6])
    return f"({shown}{', ...' if value.size > 6 else ''})"


def place_of(of: object, method: str, error: Exception | None = None) -> str:
    """A method in words: class, name, file and line, or where in its file it raised."""
    return f"{type(of).__name__}.{method} ({_place(of, method, error)})"


def _place(of: object, method: str, error: BaseException | None) -> str:
    """File and line of a method, or where in its file it raised; empty of what is no method."""
    function = getattr(type(of), method, None)
    code = getattr(inspect.unwrap(function), "__code__", None) if callable(function) else None
    if code is None:
        return ""
    line = code.co_firstlineno
    for frame, raised in traceback.walk_tb(error.__traceback__ if error else None):
        if frame.f_code.co_filename == code.co_filename:
            line = raised
    file = Path(code.co_filename)
    with contextlib.suppress(ValueError, OSError):
        file = file.relative_to(Path.cwd())
    return f"{file}, line {line}"


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
