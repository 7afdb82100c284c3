"""Claims: what a test asserts of a run, with the words for a run that does not keep it."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.run import Run

P = ParamSpec("P")
R = TypeVar("R", bound=Run)


class ClaimError(AssertionError):
    """A run does not keep what a test claims of it."""

    def __init__(self, run: Run, claim: str, words: str) -> None:
        super().__init__(f"{claim}: {words}")
        self.run = run


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
            _, *arguments = (
                inspect.signature(method).bind(run, *positional, **named).arguments.items()
            )
            values = (f"{name}={getattr(v, '__name__', repr(v))}" for name, v in arguments)
            raise ClaimError(run, f"{method.__name__}({', '.join(values)})", words)

    return asserted  # type: ignore[return-value]  # `run` may be a keyword
