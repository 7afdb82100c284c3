"""The option --real-time, which may stand without its factor."""

from collections.abc import Sequence
from typing import Annotated

import typer

OPTION = "--real-time"


def with_factor(arguments: Sequence[str]) -> list[str]:
    """The arguments, with a 1 after every --real-time that no number follows.

    Typer knows no option whose value may be left out.
    """
    completed: list[str] = []
    for argument, following in zip(arguments, [*arguments[1:], ""], strict=True):
        completed.append(argument)
        if argument == OPTION and not _is_number(following):
            completed.append("1")
    return completed


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def require_factor(factor: float | None) -> float | None:
    """Refuse a pace at which time would not go on."""
    if factor is not None and not 0.0 < factor <= 1e3:
        raise typer.BadParameter(f"expected more than 0 and at most 1000, got {factor:g}")
    return factor


RealTimeFactor = Annotated[
    float | None,
    typer.Option(
        OPTION,
        envvar="PHALANX_REAL_TIME",
        metavar="[FACTOR]",
        callback=require_factor,
        help="The wall clock decides, and nobody waits: so many seconds of virtual time per "
        "second; 1 if it is left out.",
        show_default=False,
    ),
]
