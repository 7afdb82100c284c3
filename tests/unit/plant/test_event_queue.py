"""Events that wait to be judged: all are recorded when a run ends, however it ends."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from phalanx_plant.judge import event_queue
from phalanx_plant.judge.event_queue import EventQueue
from phalanx_plant.judge.judge import Judged
from phalanx_plant.world.events import Event, InputApplied, Sampled
from phalanx_plant.world.world import DivergedError

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.messages.kinds import Telemetry
from phalanx.recording.read import read
from phalanx.recording.records import State, Step
from phalanx.recording.write import RecordingError
from tests.layers import layered
from tests.unit.plant.runs import report

pytestmark = pytest.mark.slow

FIRST, LAST = Sampled(0, 0.0), Sampled(1, 0.01)


class Desk:
    """A judge that finds nothing, and an observer with room for so many events."""

    def __init__(self, room: int = 9) -> None:
        self.seen, self.batches = list[Event](), list[list[Event]]()
        self._room = room

    def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        self.batches.append(list(events))
        judged += map(Judged, events)

    def write(self, events: Sequence[Judged]) -> None:
        for judged in events:
            if len(self.seen) == self._room:
                raise RecordingError("the disk is full")
            self.seen.append(judged.event)


def reported(i: int, k: int) -> Telemetry:
    if i:
        raise KeyError(i)
    return report(k)


def queue_of(desk: Desk) -> EventQueue:
    return EventQueue(desk, reported, [desk.write])


def run(desk: Desk, error: BaseException | None = None) -> None:
    with queue_of(desk) as queue:
        queue.add([FIRST])
        queue.add([LAST])
        if error is not None:
            raise error


def test_at_the_end_of_a_run_all_events_are_observed():
    desk = Desk()
    run(desk)
    assert desk.seen == [FIRST, LAST]


@pytest.mark.parametrize("error", [RuntimeError(), KeyboardInterrupt()])
def test_events_before_a_failure_are_observed_too_and_the_failure_is_raised(error: BaseException):
    desk = Desk()
    with pytest.raises(type(error)):
        run(desk, error)
    assert desk.seen == [FIRST, LAST]


def test_a_full_disk_is_an_error_but_does_not_hide_another():
    with pytest.raises(RecordingError):
        run(Desk(room=1))
    with pytest.raises(RuntimeError):
        run(Desk(room=1), RuntimeError())


def test_nothing_more_is_observed_once_the_disk_was_full():
    desk = Desk()
    with pytest.raises(RecordingError):
        run(desk, RecordingError())
    assert desk.seen == []


def test_the_last_events_wait_for_more_until_all_are_to_be_judged(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(event_queue, "_LONGEST", math.inf)
    desk = Desk(room=1000)
    queue = queue_of(desk)
    events = [Sampled(0, float(t)) for t in range(300)]
    for event in events:
        queue.add([event])
        queue.judge_batches()
    assert desk.seen == events[: len(desk.seen)]
    assert 1 < len(queue) == 300 - len(desk.seen) < 150
    queue.judge_all()
    assert desk.seen == events


def test_events_are_judged_in_batches_in_order_and_each_once():
    desk = Desk(room=1000)
    queue, events = queue_of(desk), [Sampled(0, float(t)) for t in range(300)]
    for event in events[:-1]:
        queue.add([event])
    for _ in range(5):
        queue.judge_next()
    queue.add([events[-1]])
    queue.judge_all()
    assert [event for some in desk.batches for event in some] == desk.seen == events
    assert 1 < max(map(len, desk.batches)) < 150


def test_a_batch_takes_no_longer_than_asked_for_even_after_cheap_events(
    monkeypatch: pytest.MonkeyPatch,
):
    now = [0.0]
    monkeypatch.setattr(event_queue.time, "thread_time", lambda: now[0])

    class Slow(Desk):
        def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
            super().judge(events, judged)
            now[0] += sum(1e-3 for event in events if not 40.0 < event.t < 60.0)

    desk = Slow(room=1000)
    queue = queue_of(desk)
    for t in range(200):
        queue.add([Sampled(0, float(t))])
    while queue:
        queue.judge_next(0.005)
    sizes = [len(some) for some in desk.batches]
    assert sizes[0] == 5
    assert sum(sizes) == 200
    assert 5 < max(sizes) < 40


def test_an_event_waits_no_longer_than_the_limit_for_others(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(event_queue, "_LONGEST", 0.0)
    desk, calls = Desk(), list[float]()
    queue = EventQueue(desk, reported, [desk.write], calls.append)
    queue.add([FIRST])
    queue.judge_batches()
    assert desk.seen == [FIRST]
    assert len(calls) == 1, "status and frames are sent then"


@pytest.mark.parametrize("scenario", layered(("unicycles", "swarm"), ("unicycles",)))
def test_the_result_of_a_run_does_not_depend_on_the_batches(
    scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def result() -> tuple[Summary, list[State], list[Step]]:
        loaded = phalanx.load(scenario, {"duration": 0.6})
        run = phalanx.run(loaded, engine="in-process", out=tmp_path)
        assert run.folder is not None
        recording = read(run.folder)
        steps = [replace(step, solve_time=0.0) for step in recording.steps]
        return replace(run.summary, wall_time=0.0), recording.states, steps

    together = result()
    monkeypatch.setattr(event_queue, "_LONGEST", 0.0)
    assert result() == together


def test_events_of_a_batch_before_one_that_fails_are_observed():
    class Broken(Desk):
        def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
            super().judge(events[:1], judged)
            raise DivergedError("h_tot", 0.0)

    desk = Broken()
    queue = queue_of(desk)
    queue.add([FIRST, LAST])
    with pytest.raises(DivergedError):
        queue.judge_all()
    assert desk.seen == [FIRST]


def test_a_report_that_does_not_arrive_leaves_the_other_events_to_be_judged():
    desk, nothing = Desk(), np.zeros(2)
    queue = queue_of(desk)
    queue.add([FIRST, *(InputApplied(i, 0, 0.0, 0.0, nothing) for i in (2, 0, 1)), LAST])
    with pytest.raises(KeyError, match="2"):
        queue.judge_all()
    first, applied, last = desk.seen
    assert (first, last) == (FIRST, LAST)
    assert (applied.i, applied.telemetry) == (0, reported(0, 0))


def test_events_that_cannot_be_judged_after_a_failure_do_not_hide_it():
    class Broken(Desk):
        def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
            raise DivergedError("h_tot", 0.0)

    with pytest.raises(KeyboardInterrupt):
        run(Broken(), KeyboardInterrupt())
