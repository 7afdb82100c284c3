"""What every engine has in common: how it is chosen, how it tells of progress, how it fails."""

from collections.abc import Callable
from typing import Literal

from phalanx.wire.messages import Status

Engine = Literal["processes", "in-process"]
"""processes: every program a process of its own, over Zenoh. in-process: the same control steps
called directly, for studies of many runs. Both give the same trajectory to the last bit."""

Progress = Callable[[Status], None]
"""Called a few times a second while a run goes on, perhaps in another thread."""


class EngineError(RuntimeError):
    """A run could not begin, or ended without a verdict; the message says which program and why."""


def silent(status: Status) -> None:
    """A progress callback that says nothing."""
