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
from phalanx_plant.world.events import Event, Instant, StoppedError, SwarmBrokenError
from phalanx_plant.world.world import DivergedError

_BATCH = 24
"""Most instants prepared in one call: h, ψ and certificates cost least for many at once."""
_LONGEST = 0.1
"""While agents compute, all events are judged this often, however few there are, for viewers
[s of wall time]."""


class EventJudge(Protocol):
    """The judge, as the queue uses it."""

    def prepare(self, events: Sequence[Event]) -> None:
        """Compute in one call what the judgement of these next events needs."""

    def judge(self, instant: Instant, judged: list[Judged]) -> None:
        """Judge the events of the next instant, which were prepared, and append the results."""


class EventQueue:
    """Instants in their order; leaving the context judges those that are left."""

    def __init__(
        self,
        judge: EventJudge,
        observers: Sequence[Callable[[Sequence[Judged]], None]],
        idle: Callable[[float], None] = lambda now: None,
    ) -> None:
        """Begin with no events.

        Args:
            judge: of the run.
            observers: receive the judged events of each instant, in this order.
            idle: called at a wall time [s], for work that can wait.
        """
        self._idle = idle
        self._judge, self._observers = judge, observers
        self._instants: deque[Instant] = deque()
        self._prepared = 0
        """Number of instants, the oldest, that are prepared."""
        self._cost = 1e-3
        """Estimated CPU time of preparing one instant [s]."""
        self._due = time.monotonic() + _LONGEST

    def __len__(self) -> int:
        return len(self._instants)

    def idle(self) -> None:
        """Do work that can wait."""
        self._idle(time.monotonic())

    def add(self, instant: Instant) -> None:
        """Append the events of the next instant."""
        self._instants.append(instant)

    def judge_next(self, seconds: float = math.inf) -> None:
        """Judge and observe the oldest instant. Raises RecordingError, DivergedError.

        seconds: about how long to prepare a batch, which nothing interrupts [s of CPU time].
        """
        if not self._prepared:
            self._prepare(seconds)
        self._prepared -= 1
        judged: list[Judged] = []
        try:
            self._judge.judge(self._instants.popleft(), judged)
        finally:
            for observe in self._observers:
                observe(judged)

    def _prepare(self, seconds: float) -> None:
        affordable = max(1.0, seconds / max(self._cost, 1e-9))
        instants = list(islice(self._instants, int(min(affordable, _BATCH))))
        began = time.thread_time()
        self._judge.prepare([event for instant in instants for event in instant])
        cost = (time.thread_time() - began) / len(instants)
        # Costs differ: a few instants that cost nothing must not make the next batch large.
        self._prepared, self._cost = len(instants), max(cost, 0.9 * self._cost)

    def judge_batches(self) -> None:
        """Judge all but the last instants, which wait for more. Raises as judge_next does."""
        now = time.monotonic()
        if now >= self._due:
            self.judge_all()
            self._due = time.monotonic() + _LONGEST
            return
        while len(self._instants) > _BATCH:
            self.judge_next()
        self._idle(now)

    def judge_all(self) -> None:
        """Judge all events. Raises as judge_next does."""
        while self._instants:
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
