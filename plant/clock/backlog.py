"""What happened and is still to be written down, as soon as there is time."""

import contextlib
from collections import deque
from types import TracebackType
from typing import Protocol, Self

from phalanx.plant.events.events import Event
from phalanx.recording.write import RecordingError


class Witness(Protocol):
    """Whoever is told what happened, while there is time."""

    def witness(self, event: Event) -> None:
        """Take the next event."""

    def idle(self) -> None:
        """Called when there is time for what waits until then."""


class Backlog(deque[Event]):
    """Events in their order; whatever is left of them at the end of a run is told then."""

    def __init__(self, scribe: Witness) -> None:
        super().__init__()
        self._scribe = scribe

    def write_one(self) -> None:
        """Tell the scribe of the oldest."""
        self._scribe.witness(self.popleft())

    def write_down(self) -> None:
        """Tell the scribe of all. Raises RecordingError."""
        while self:
            self.write_one()
        self._scribe.idle()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.write_down()
        elif not isinstance(error, RecordingError):
            # What led to the failure is worth as much as the rest.
            with contextlib.suppress(RecordingError):
                self.write_down()
