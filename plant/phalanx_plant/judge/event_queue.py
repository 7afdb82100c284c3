"""The queue of events that wait to be judged, recorded and shown."""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol, Self

from msgspec.structs import replace

from phalanx.messages.kinds import Telemetry
from phalanx.recording.write import RecordingError
from phalanx_plant.judge.judge import Judged
from phalanx_plant.world.events import (
    Event,
    InputApplied,
    InputLost,
    Instant,
    StoppedError,
    SwarmBrokenError,
)
from phalanx_plant.world.world import DivergedError

BATCH = 24
"""Most instants judged in one call while agents compute elsewhere, which then wait for it."""
LARGE_BATCH = 512
"""The same where nobody waits: one call for many instants costs least."""
_LONGEST = 0.1
"""With small batches all events are judged this often, however few there are, for viewers; with
larger ones as much less often [s of wall time]."""


class EventJudge(Protocol):
    """The judge, as the queue uses it."""

    def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        """Judge the next events in order, and append the results."""


class EventQueue:
    """Instants in their order; leaving the context judges those that are left."""

    def __init__(
        self,
        judge: EventJudge,
        await_telemetry: Callable[[int, int], Telemetry],
        observers: Sequence[Callable[[Sequence[Judged]], None]],
        idle: Callable[[float], None] = lambda now: None,
        batch: int = BATCH,
    ) -> None:
        """Begin with no events.

        Args:
            judge: of the run.
            await_telemetry: waits for agent i's report on its sample k, and returns it.
            observers: receive the judged events of some instants, in this order.
            idle: called at a wall time [s], for work that can wait.
            batch: most instants judged in one call.
        """
        self._idle, self._batch = idle, batch
        self._judge, self._observers = judge, observers
        self._await_telemetry = await_telemetry
        self._instants: deque[Instant] = deque()
        self._cost = 1e-3
        """Estimated CPU time of judging one instant [s]."""
        self._longest = _LONGEST * batch / BATCH
        self._due = time.monotonic() + self._longest

    def __len__(self) -> int:
        return len(self._instants)

    def idle(self) -> None:
        """Do work that can wait."""
        self._idle(time.monotonic())

    def add(self, instant: Instant) -> None:
        """Append the events of the next instant."""
        self._instants.append(instant)

    def judge_next(self, seconds: float = math.inf) -> None:
        """Judge and observe the oldest instants. Raises RecordingError, DivergedError.

        Also what the first report that does not arrive raises, once all other events are observed.
        seconds: about how long it may take, as nothing interrupts it [s of CPU time].
        """
        affordable = max(1.0, seconds / max(self._cost, 1e-9))
        count = int(min(affordable, self._batch, len(self._instants)))
        began, judged, events = time.thread_time(), list[Judged](), list[Event]()
        failure: Exception | None = None
        for event in [event for _ in range(count) for event in self._instants.popleft()]:
            try:
                events.append(self._reported(event))
            except Exception as error:
                failure = failure or error
        try:
            self._judge.judge(events, judged)
        finally:
            for observe in self._observers:
                observe(judged)
        if failure is not None:
            raise failure
        # Costs differ: a few instants that cost nothing must not make the next batch large.
        self._cost = max((time.thread_time() - began) / count, 0.9 * self._cost)

    def _reported(self, event: Event) -> Event:
        """Add its agent's report to an input, which is awaited only now: agents send it last."""
        if type(event) is InputApplied or type(event) is InputLost:
            return replace(event, telemetry=self._await_telemetry(event.i, event.k))
        return event

    def judge_batches(self) -> None:
        """Judge all but the last instants, which wait for more. Raises as judge_next does."""
        if time.monotonic() >= self._due:
            self.judge_all()
            self._due = time.monotonic() + self._longest
            return
        while len(self._instants) > self._batch:
            self.judge_next()
            self.idle()

    def judge_all(self) -> None:
        """Judge all events. Raises as judge_next does."""
        while self._instants:
            self.judge_next()
        self.idle()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if error is None:
            self.judge_all()
        elif not isinstance(error, RecordingError):
            # Record the events that led to the failure, as far as they can be judged.
            with contextlib.suppress(RecordingError, DivergedError, SwarmBrokenError, StoppedError):
                self.judge_all()
