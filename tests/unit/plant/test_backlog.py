"""What is still to be written down when a run ends, however it ends."""

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace
from phalanx_plant.judge import backlog
from phalanx_plant.judge.backlog import Backlog
from phalanx_plant.judge.judge import Judged
from phalanx_plant.world.events import Event, Sampled
from phalanx_plant.world.world import DivergedError

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.recording.read import read
from phalanx.recording.records import Step
from phalanx.recording.write import RecordingError

FIRST, LAST = Sampled(0, 0.0), Sampled(1, 0.01)


class Desk:
    """A judge that finds nothing, and an observer with room for so many events."""

    def __init__(self, room: int = 9) -> None:
        self.told, self.prepared = list[Event](), list[list[Event]]()
        self._room = room

    def prepare(self, events: Sequence[Event]) -> None:
        self.prepared.append(list(events))

    def take(self, event: Event) -> Judged:
        return Judged(event)

    def write(self, judged: Judged) -> None:
        if len(self.told) == self._room:
            raise RecordingError("the disk is full")
        self.told.append(judged.event)


def backlog_of(desk: Desk) -> Backlog:
    return Backlog(desk, [desk.write])


def run(desk: Desk, error: BaseException | None = None) -> None:
    with backlog_of(desk) as happened:
        happened.add(FIRST)
        happened.add(LAST)
        if error is not None:
            raise error


def test_at_the_end_of_a_run_all_is_told():
    desk = Desk()
    run(desk)
    assert desk.told == [FIRST, LAST]


@pytest.mark.parametrize("error", [RuntimeError(), KeyboardInterrupt()])
def test_what_led_to_a_failure_is_told_too_and_the_failure_goes_on(error: BaseException):
    desk = Desk()
    with pytest.raises(type(error)):
        run(desk, error)
    assert desk.told == [FIRST, LAST]


def test_a_full_disk_is_an_error_but_does_not_hide_another():
    with pytest.raises(RecordingError):
        run(Desk(room=1))
    with pytest.raises(RuntimeError):
        run(Desk(room=1), RuntimeError())


def test_nothing_more_is_told_once_the_disk_was_full():
    desk = Desk()
    with pytest.raises(RecordingError):
        run(desk, RecordingError())
    assert desk.told == []


def test_while_there_is_time_the_last_few_wait_for_what_comes_and_are_told_when_asked(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(backlog, "_LONGEST", math.inf)
    desk = Desk(room=1000)
    happened = backlog_of(desk)
    events = [Sampled(0, float(t)) for t in range(300)]
    for event in events:
        happened.add(event)
        happened.judge_most()
    assert desk.told == events[: len(desk.told)]
    assert 1 < len(happened) == 300 - len(desk.told) < 150
    happened.judge_all()
    assert desk.told == events


def test_what_events_need_is_worked_out_for_several_at_once_in_their_order_and_of_each_once():
    """Few at once however many wait: in real time the next sample may be due before."""
    desk = Desk(room=1000)
    happened, events = backlog_of(desk), [Sampled(0, float(t)) for t in range(300)]
    for event in events[:-1]:
        happened.add(event)
    for _ in range(150):
        happened.judge_one()
    happened.add(events[-1])
    happened.judge_all()
    assert [event for some in desk.prepared for event in some] == desk.told == events
    assert 1 < max(map(len, desk.prepared)) < 150


def test_an_event_waits_no_longer_than_a_moment_for_others(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(backlog, "_LONGEST", 0.0)
    desk = Desk()
    happened = backlog_of(desk)
    happened.add(FIRST)
    happened.judge_most()
    assert desk.told == [FIRST]


@pytest.mark.parametrize("scenario", ["unicycles", "swarm"])
def test_what_a_run_came_to_does_not_depend_on_how_many_events_waited_for_others(
    scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def told() -> tuple[Summary, list[Step]]:
        loaded = phalanx.load(scenario, {"duration": 0.3})
        run = phalanx.run(loaded, engine="in-process", out=tmp_path)
        assert run.folder is not None
        steps = [replace(step, solve_time=0.0) for step in read(run.folder).steps]
        return replace(run.summary, wall_time=0.0), steps

    together = told()
    monkeypatch.setattr(backlog, "_LONGEST", 0.0)
    assert told() == together


def test_events_that_cannot_be_told_after_a_failure_do_not_hide_it():
    class Broken(Desk):
        def take(self, event: Event) -> Judged:
            raise DivergedError("h_tot", 0.0)

    with pytest.raises(KeyboardInterrupt):
        run(Broken(), KeyboardInterrupt())
