"""What happened and is still to be written down, as soon as there is time."""

import contextlib
import time
from collections import deque
from types import TracebackType
from typing import Protocol, Self

from phalanx.recording.write import RecordingError
from phalanx_plant.events.events import Event
from phalanx_plant.events.stop import StoppedError, SwarmBrokenError
from phalanx_plant.world.world import DivergedError

_AT_ONCE = 96
"""So many events may wait, though there is time: what they need is worked out for all at once."""
_LONGEST = 0.1
"""Where events are few, all are told every so often [s of wall time], while answers come: somebody
may look."""


class Witness(Protocol):
    """Whoever is told what happened, while there is time."""

    def expect(self, event: Event) -> None:
        """This will be told, after all that was expected before."""

    def witness(self, event: Event) -> None:
        """Take the next event."""

    def idle(self) -> None:
        """Called when there is time for what waits until then."""


class Backlog:
    """Events in their order; whatever is left of them at the end of a run is told then."""

    def __init__(self, scribe: Witness) -> None:
        self._scribe = scribe
        self._events: deque[Event] = deque()
        self._due = time.monotonic() + _LONGEST

    def __len__(self) -> int:
        return len(self._events)

    def add(self, event: Event) -> None:
        """This happened next."""
        self._events.append(event)
        self._scribe.expect(event)

    def write_one(self) -> None:
        """Tell the scribe of the oldest."""
        self._scribe.witness(self._events.popleft())

    def write_most(self) -> None:
        """Tell the scribe of all but the last few. Raises RecordingError, DivergedError."""
        if time.monotonic() >= self._due:
            self.write_down()
            self._due = time.monotonic() + _LONGEST
            return
        while len(self) > _AT_ONCE:
            self.write_one()
        self._scribe.idle()

    def write_down(self) -> None:
        """Tell the scribe of all. Raises RecordingError, DivergedError."""
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
            # What led to the failure is worth as much as the rest, as far as it can be told.
            with contextlib.suppress(RecordingError, DivergedError, SwarmBrokenError, StoppedError):
                self.write_down()
