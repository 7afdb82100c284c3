"""Call methods of users' own classes and check their results: an error names class and line."""

import contextlib
import inspect
import math
import re
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from threading import get_ident
from typing import Any

import casadi as ca
from numpy.typing import NDArray

Shape = tuple[int, ...]

running_calls: dict[int, object] = {}
"""By thread, an object for the call of a user's method that is running; a new one for each call."""


class EndlessLoopError(BaseException):
    """Raised in a user's method that does not return; no Exception, which the method may catch."""

    def __str__(self) -> str:
        return "an endless loop, or too slow"


class MistakenMethodError(ValueError):
    """A user's method failed, or returned a wrong type or shape; the message says where."""

    def __init__(
        self,
        of: object,
        method: str,
        expected: str,
        got: str,
        error: BaseException | None = None,
        agent: str = "",
    ) -> None:
        """error: the method's exception, if it raised one. agent: name of the agent it served."""
        self.agent = agent
        self._method, self._expected = f"{type(of).__name__}.{method}", expected
        self._got, self._error = got, error
        self.expected = f"{self._method}: expected {expected}{agent and f' for agent {agent}'}"
        """The first half of the message: method and expected result."""
        place = _place(of, method, error)
        self._place = f" ({place})" if place else ""
        self.got = got + self._place
        super().__init__(f"{self.expected}, got {self.got}")

    def during_run(self, subject: str) -> str:
        """The message during a run; subject: the agent, message or pair that was being computed."""
        match self._error:
            case None:
                did = f"returned {self._got} for {subject}: expected {self._expected}"
            case EndlessLoopError():
                did = f"has not returned for {subject}: {self._got}"
            case _:
                did = f"raised {self._got} for {subject}"
        return f"{self._method} {did}{self._place}"


def call_user(of: object, method: str, expected: str, *arguments: Any, agent: str = "") -> Any:
    """Call a method of a user's class, for an agent if there is one.

    Raises:
        MistakenMethodError: it raised anything, or does not return.
    """
    thread = get_ident()
    running_calls[thread] = object()
    try:
        return getattr(of, method)(*arguments)
    except (Exception, EndlessLoopError) as error:  # it may raise anything
        raise MistakenMethodError(of, method, expected, error_line(error), error, agent) from error
    finally:
        running_calls.pop(thread, None)


def is_built_in(of: object) -> bool:
    """Return whether an object's class is one of ours."""
    return type(of).__module__.startswith("phalanx.")


def watched_method(of: object, method: str, expected: str, agent: str) -> Callable[..., Any]:
    """Return a method of a class, called by call_user if the class is not one of ours."""
    if is_built_in(of):
        found: Callable[..., Any] = getattr(of, method)
        return found
    return partial(call_user, of, method, expected, agent=agent)


def error_line(error: BaseException) -> str:
    """Type and text of an error in one line."""
    if isinstance(error, EndlessLoopError):
        return str(error)
    # CasADi's last line has the cause, after a place in CasADi; so have the lines before it.
    lines = str(error).strip().splitlines() or ["no reason given"]
    cause = re.sub(r"^\S*/casadi/\S+: ", "", lines[-1])
    hint = " Use casadi's if_else in place of if" if "truth value of a CasADi" in cause else ""
    return f"{type(error).__name__}: {cause}{hint}"


def first_numbers(value: NDArray[Any]) -> str:
    """The first six numbers of an array as text."""
    shown = ", ".join(f"{number:.4g}" for number in value.ravel()[:6])
    return f"({shown}{', ...' if value.size > 6 else ''})"


def located_method(of: object, method: str, error: Exception | None = None) -> str:
    """Class, name, file and line of a method; the line is that of the error, if there is one."""
    return f"{type(of).__name__}.{method} ({_place(of, method, error)})"


def _place(of: object, method: str, error: BaseException | None) -> str:
    """File and line of a method, or of its error; empty if there is no such method."""
    function = getattr(type(of), method, None)
    code = getattr(inspect.unwrap(function), "__code__", None) if callable(function) else None
    if code is None:
        return ""
    line = code.co_firstlineno
    for frame, raised in traceback.walk_tb(error.__traceback__ if error else None):
        if frame.f_code.co_filename == code.co_filename:
            line = raised
    return f"{_shown(code.co_filename)}, line {line}"


def located_class(cls: type) -> str:
    """Name, file and line of a class; the name alone if its source is unknown."""
    try:
        file, line = inspect.getsourcefile(cls), inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return cls.__name__
    return f"{cls.__name__} ({_shown(file or '')}, line {line})"


def _shown(file: str) -> Path:
    """A file's path, relative to the working directory if it lies there."""
    with contextlib.suppress(ValueError, OSError):
        return Path(file).relative_to(Path.cwd())
    return Path(file)


def call_for_expression(
    of: object, method: str, shapes: Sequence[Shape], *arguments: Any, symbols: Sequence[ca.SX]
) -> ca.SX:
    """Call a user's method that returns a CasADi expression.

    Args:
        of: the object.
        method: name of its method.
        shapes: those allowed: () for a scalar, (n,) for a column, (n, m) for a matrix.
        arguments: of the call.
        symbols: the only ones that the expression may contain.

    Raises:
        MistakenMethodError: it raised anything, or returned something else.
    """
    found = call_user(of, method, _expected(shapes), *arguments)
    return require_expression(of, method, shapes, found, symbols=symbols)


def require_expression(
    of: object, method: str, shapes: Sequence[Shape], value: Any, *, symbols: Sequence[ca.SX]
) -> ca.SX:
    """Check a value that a user's method has returned; arguments as in call_for_expression."""
    expected = _expected(shapes)
    try:
        found = ca.SX(value)
    except Exception as error:  # CasADi raises several types
        got = "None" if value is None else f"a {type(value).__name__} that is no expression"
        raise MistakenMethodError(of, method, expected, got) from error
    if found.shape not in [(*shape, 1, 1)[:2] for shape in shapes]:
        got = _described(found.shape if found.shape[1] != 1 else found.shape[:1])
        raise MistakenMethodError(of, method, expected, got)
    known = {symbol.element_hash() for part in symbols for symbol in ca.symvar(part)}
    for symbol in ca.symvar(found):
        if symbol.element_hash() not in known:
            expected = "an expression of its arguments alone"
            raise MistakenMethodError(of, method, expected, f"one of {symbol} too")
    if _has_nan(found):
        expected = f"{expected} made with casadi's functions"
        raise MistakenMethodError(of, method, expected, "nan: functions of math take numbers alone")
    return found


def _has_nan(expression: ca.SX) -> bool:
    """Return whether not a number is among the constants of an expression."""
    function = ca.Function("f", ca.symvar(expression), [expression])
    return any(
        function.instruction_id(k) == ca.OP_CONST and math.isnan(function.instruction_constant(k))
        for k in range(function.n_instructions())
    )


def _expected(shapes: Sequence[Shape]) -> str:
    return " or ".join(map(_described, shapes))


def _described(shape: Shape) -> str:
    return f"shape {shape}" if shape else "a scalar"
