"""The queue of events that wait to be judged, recorded and shown."""

import contextlib
import math
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

_BATCH = 96
"""Most events prepared in one call: h, ψ and certificates cost least for many at once."""
_LONGEST = 0.1
"""While agents compute, all events are judged this often, however few there are, for viewers
[s of wall time]."""


class EventJudge(Protocol):
    """The judge, as the queue uses it."""

    def prepare(self, events: Sequence[Event]) -> None:
        """Compute in one call what the judgement of these next events needs."""

    def judge(self, event: Event) -> Judged | None:
        """Judge the next event, which was prepared; None if nothing of it is recorded or shown."""


class EventQueue:
    """Events in their order; leaving the context judges those that are left."""

    def __init__(
        self,
        judge: EventJudge,
        observers: Sequence[Callable[[Judged], None]],
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin with no events.

        Args:
            judge: of the run.
            observers: receive each judged event, in this order.
            idle: called between batches, for work that can wait.
        """
        self.idle = idle
        self._judge, self._observers = judge, observers
        self._events: deque[Event] = deque()
        self._prepared = 0
        """Number of events, the oldest, that are prepared."""
        self._cost = 1e-3
        """Estimated CPU time of preparing one event [s]."""
        self._due = time.monotonic() + _LONGEST

    def __len__(self) -> int:
        return len(self._events)

    def add(self, event: Event) -> None:
        """Append the next event."""
        self._events.append(event)

    def judge_next(self, seconds: float = math.inf) -> None:
        """Judge and observe the oldest event. Raises RecordingError, DivergedError.

        seconds: about how long to prepare a batch, which nothing interrupts [s of CPU time].
        """
        if not self._prepared:
            self._prepare(seconds)
        self._prepared -= 1
        judged = self._judge.judge(self._events.popleft())
        if judged is not None:
            for observe in self._observers:
                observe(judged)

    def _prepare(self, seconds: float) -> None:
        affordable = max(1.0, seconds / max(self._cost, 1e-9))
        events = list(islice(self._events, int(min(affordable, _BATCH))))
        began = time.thread_time()
        self._judge.prepare(events)
        cost = (time.thread_time() - began) / len(events)
        # Costs differ: a few events that cost nothing must not make the next batch large.
        self._prepared, self._cost = len(events), max(cost, 0.9 * self._cost)

    def judge_batches(self) -> None:
        """Judge all but the last events, which wait for more. Raises as judge_next does."""
        if time.monotonic() >= self._due:
            self.judge_all()
            self._due = time.monotonic() + _LONGEST
            return
        for _ in range(len(self._events) - _BATCH):
            self.judge_next()
        self.idle()

    def judge_all(self) -> None:
        """Judge all events. Raises as judge_next does."""
        while self._events:
            self.judge_next()
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
            # Record the events that led to the failure, as far as they can be judged.
            with contextlib.suppress(RecordingError, DivergedError, SwarmBrokenError, StoppedError):
                self.judge_all()
