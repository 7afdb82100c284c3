"""What every engine has in common: how it is chosen, how it tells of progress, how it fails."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args

from phalanx.wire.messages import Status

Engine = Literal["processes", "in-process"]
"""processes: every program a process of its own, over Zenoh. in-process: the same control steps
called directly, for studies of many runs. Both give the same trajectory to the last bit."""

Progress = Callable[[Status], None]
"""Called a few times a second while a run goes on, perhaps in another thread."""

Announce = Callable[[Path], object]
"""Called once with a run's folder, when the run can be met there."""


def require_engine(engine: str) -> None:
    """Raise ValueError unless there is an engine of this name."""
    if engine not in get_args(Engine):
        names = " or ".join(map(repr, get_args(Engine)))
        raise ValueError(f"engine: expected {names}, got {engine!r}")


def require_functions(**options: object) -> None:
    """Raise ValueError unless each option, by its name, can be called."""
    for name, option in options.items():
        if not callable(option):
            raise ValueError(f"{name}: expected a function to call, got {option!r}")


class EngineError(RuntimeError):
    """A run could not begin, or ended without a verdict; the message says which program and why."""


def silent(_: object) -> None:
    """A callback that says nothing."""
