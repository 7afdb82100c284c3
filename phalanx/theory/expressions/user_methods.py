"""Call methods of users' own classes and check their results: an error names class and line."""

import contextlib
import inspect
import math
import re
import traceback
from collections.abc import Callable, Sequence
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
        self, of: object, method: str, expected: str, got: str, error: BaseException | None = None
    ) -> None:
        """error: the method's exception, if it raised one."""
        self.expected = f"{type(of).__name__}.{method}: expected {expected}"
        """The first half of the message: method and expected result."""
        location = _location(of, method, error)
        self.got = f"{got} ({location})" if location else got

    def __str__(self) -> str:
        return f"{self.expected}, got {self.got}"

    def name_agent(self, name: str) -> None:
        """Add the agent that the method served."""
        self.expected += f" for agent {name}"


Check = Callable[..., Any]
"""(object, result of its method, arguments of the call) -> the result; MistakenMethodError."""

checks: dict[tuple[type, str], Check] = {}
"""Checks of what a user's method returns, by kind and method."""


def check_of(kind: type, method: str) -> Callable[[Check], Check]:
    """Declare the check of what a method returns, in the module of its protocol."""
    return lambda check: checks.setdefault((kind, method), check)


_REFUSING = ("prepare", "join", "require_robots")
"""Methods that raise ValueError, by their protocol, of what does not fit."""


def call_user(of: object, method: str, call: Callable[[], Any]) -> Any:
    """Return the result of a call of a user's method, in which endless loops are interrupted.

    Raises:
        MistakenMethodError: it raised anything, or does not return.
        ValueError: it refuses what does not fit, by its protocol.
    """
    thread = get_ident()
    if thread in running_calls:  # of a user's method, which may expect this one's errors
        return call()
    running_calls[thread] = object()
    try:
        return call()
    except (Exception, EndlessLoopError) as error:  # it may raise anything
        refuses = method in _REFUSING and isinstance(error, ValueError)
        if refuses or isinstance(error, MistakenMethodError):
            raise
        raise MistakenMethodError(of, method, "no error", error_line(error), error) from error
    finally:
        running_calls.pop(thread, None)


def is_built_in(of: object) -> bool:
    """Return whether a class, or the class of an object, is one of ours."""
    cls = of if isinstance(of, type) else type(of)
    return cls.__module__.startswith("phalanx.")


def error_line(error: BaseException) -> str:
    """Type and text of an error in one line."""
    if isinstance(error, EndlessLoopError | MistakenMethodError):
        return str(error)
    # CasADi's last line has the cause, after a place in CasADi; so have the lines before it.
    lines = str(error).strip().splitlines() or ["no reason given"]
    cause = re.sub(r"^\S*/casadi/\S+: ", "", lines[-1])
    hint = " Use casadi's if_else in place of if" if "truth value of a CasADi" in cause else ""
    return f"{type(error).__name__}: {cause}{hint}"


def first_numbers(value: NDArray[Any]) -> str:
    """The first six numbers of an array as text."""
    numbers = ", ".join(f"{number:.4g}" for number in value.ravel()[:6])
    return f"({numbers}{', ...' if value.size > 6 else ''})"


def located_method(of: object, method: str) -> str:
    """Class, name, file and line of a method."""
    return f"{type(of).__name__}.{method} ({_location(of, method, None)})"


def _location(of: object, method: str, error: BaseException | None) -> str:
    """File and line of a method, or of its error; empty if there is no such method."""
    function = getattr(type(of), method, None)
    code = getattr(inspect.unwrap(function), "__code__", None) if callable(function) else None
    if code is None:
        return ""
    line = code.co_firstlineno
    for frame, raised in traceback.walk_tb(error.__traceback__ if error else None):
        if frame.f_code.co_filename == code.co_filename:
            line = raised
    return f"{_relative_path(code.co_filename)}, line {line}"


def located_class(cls: type) -> str:
    """Name, file and line of a class; the name alone if its source is unknown."""
    try:
        file, line = inspect.getsourcefile(cls), inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return cls.__name__
    return f"{cls.__name__} ({_relative_path(file or '')}, line {line})"


def _relative_path(file: str) -> Path:
    """A file's path, relative to the working directory if it lies there."""
    with contextlib.suppress(ValueError, OSError):
        return Path(file).relative_to(Path.cwd())
    return Path(file)


def require_expression(
    of: object, method: str, shapes: Sequence[Shape], value: Any, *, symbols: Sequence[ca.SX]
) -> ca.SX:
    """Return what a method returned as a CasADi expression.

    Args:
        of: the object.
        method: name of its method.
        shapes: those allowed: () for a scalar, (n,) for a column, (n, m) for a matrix.
        value: the result.
        symbols: the only ones that the expression may contain.

    Raises MistakenMethodError if it is no such expression.
    """
    expected = " or ".join(map(_described, shapes))
    try:
        expression = ca.SX(value)
    except Exception as error:  # CasADi raises several types
        got = "None" if value is None else f"a {type(value).__name__} that is no expression"
        raise MistakenMethodError(of, method, expected, got) from error
    if expression.shape not in [(*shape, 1, 1)[:2] for shape in shapes]:
        got = _described(expression.shape if expression.shape[1] != 1 else expression.shape[:1])
        raise MistakenMethodError(of, method, expected, got)
    hashes = {symbol.element_hash() for part in symbols for symbol in ca.symvar(part)}
    for symbol in ca.symvar(expression):
        if symbol.element_hash() not in hashes:
            expected = "an expression of its arguments alone"
            raise MistakenMethodError(of, method, expected, f"one of {symbol} too")
    if _has_nan(expression):
        expected = f"{expected} made with casadi's functions"
        raise MistakenMethodError(of, method, expected, "nan: functions of math take numbers alone")
    return expression


def declare_scalar(kind: type, method: str, symbols: Callable[..., Sequence[ca.SX]]) -> None:
    """Declare that a method returns a scalar expression.

    symbols: returns those that it may contain, from the arguments of the call.
    """

    @check_of(kind, method)
    def check(of: object, value: Any, *arguments: Any) -> ca.SX:
        return require_expression(of, method, [()], value, symbols=symbols(*arguments))


def _has_nan(expression: ca.SX) -> bool:
    """Return whether not a number is among the constants of an expression."""
    function = ca.Function("f", ca.symvar(expression), [expression])
    return any(
        function.instruction_id(k) == ca.OP_CONST and math.isnan(function.instruction_constant(k))
        for k in range(function.n_instructions())
    )


def _described(shape: Shape) -> str:
    return f"shape {shape}" if shape else "a scalar"
