"""What happened and is still to be judged, as soon as there is time."""

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice
from types import TracebackType
from typing import Protocol, Self

from phalanx.recording.write import RecordingError
from phalanx_plant.judge.judge import Judged
from phalanx_plant.world.events import Event, StoppedError, SwarmBrokenError
from phalanx_plant.world.world import DivergedError

_AT_ONCE = 96
"""So many events may wait, though there is time: what they need is worked out for all at once, and
nothing interrupts that; in real time an input may be due meanwhile."""
_LONGEST = 0.1
"""Where events are few, all are judged every so often [s of wall time], while answers come:
somebody may look."""


class EventJudge(Protocol):
    """The judge, as it is asked."""

    def prepare(self, events: Sequence[Event]) -> None:
        """Work out what these, which are judged next, need."""

    def take(self, event: Event) -> Judged:
        """Judge the next event, which was prepared."""


class Backlog:
    """Events in their order; those that are left at the end of a run are judged then."""

    def __init__(
        self,
        judge: EventJudge,
        observers: Sequence[Callable[[Judged], None]],
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin with nothing.

        Args:
            judge: of the run.
            observers: take each event, one after the other, once it was judged.
            idle: called when there is time for what waits until then.
        """
        self.idle = idle
        self._judge, self._observers = judge, observers
        self._events: deque[Event] = deque()
        self._prepared = 0
        """How many of them, the oldest."""
        self._due = time.monotonic() + _LONGEST

    def __len__(self) -> int:
        return len(self._events)

    def add(self, event: Event) -> None:
        """This happened next."""
        self._events.append(event)

    def judge_one(self) -> None:
        """Have the oldest judged and observed. Raises RecordingError, DivergedError."""
        if not self._prepared:
            events = list(islice(self._events, _AT_ONCE))
            self._judge.prepare(events)
            self._prepared = len(events)
        self._prepared -= 1
        judged = self._judge.take(self._events.popleft())
        for observe in self._observers:
            observe(judged)

    def judge_most(self) -> None:
        """Have all but the last few judged. Raises RecordingError, DivergedError."""
        if time.monotonic() >= self._due:
            self.judge_all()
            self._due = time.monotonic() + _LONGEST
            return
        while len(self) > _AT_ONCE:
            self.judge_one()
        self.idle()

    def judge_all(self) -> None:
        """Have all judged. Raises RecordingError, DivergedError."""
        while self:
            self.judge_one()
        self.idle()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.judge_all()
        elif not isinstance(error, RecordingError):
            # What led to the failure is worth as much as the rest, as far as it can be judged.
            with contextlib.suppress(RecordingError, DivergedError, SwarmBrokenError, StoppedError):
                self.judge_all()
