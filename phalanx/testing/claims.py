"""Claims: what a test asserts of a run, with the words for a run that does not keep it."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.run import Run

P = ParamSpec("P")
R = TypeVar("R", bound=Run)


class Claim(NamedTuple):
    """An assertion of a run, and its arguments."""

    run: Run
    method: str
    arguments: Mapping[str, Any]

    def __str__(self) -> str:
        values = (f"{n}={getattr(v, '__name__', repr(v))}" for n, v in self.arguments.items())
        return f"{self.method}({', '.join(values)})"


class ClaimError(AssertionError):
    """A run does not keep what a test claims of it; `claim` is the assertion."""

    def __init__(self, claim: Claim, words: str) -> None:
        super().__init__(f"{claim}: {words}")
        self.claim = claim


def claim(method: Callable[Concatenate[R, P], str | None]) -> Callable[Concatenate[R, P], None]:
    """Make an assertion of a method that returns in words why a run does not keep it.

    It raises ClaimError, also of a run that broke.
    """

    @wraps(method)
    def asserted(run: R, *positional: P.args, **named: P.kwargs) -> None:
        __tracebackhide__ = True
        summary = run.summary
        if summary is None or summary.outcome is Outcome.BROKEN:
            words: str | None = summary.reason if summary else run.recording.unfinished
            words = f"the run broke: {words}"
        else:
            words = method(run, *positional, **named)
        if words:
            bound = inspect.signature(method).bind(run, *positional, **named).arguments
            arguments = {name: value for name, value in bound.items() if value is not run}
            raise ClaimError(Claim(run, method.__name__, arguments), words)

    return asserted  # type: ignore[return-value]  # `run` may be a keyword
