"""What is still to be written down when a run ends, however it ends."""

import math
from pathlib import Path

import pytest
from msgspec.structs import replace
from phalanx_plant.clock import backlog
from phalanx_plant.clock.backlog import Backlog
from phalanx_plant.events.events import Event, Sampled
from phalanx_plant.world.world import DivergedError

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.recording.read import read
from phalanx.recording.records import Step
from phalanx.recording.write import RecordingError

FIRST, LAST = Sampled(0, 0.0), Sampled(1, 0.01)


class Scribe:
    def __init__(self, room: int = 9) -> None:
        self.told, self.expected = list[Event](), list[Event]()
        self._room = room

    def expect(self, event: Event) -> None:
        self.expected.append(event)

    def witness(self, event: Event) -> None:
        assert event in self.expected
        if len(self.told) == self._room:
            raise RecordingError("the disk is full")
        self.told.append(event)

    def idle(self) -> None: ...


def run(scribe: Scribe, error: BaseException | None = None) -> None:
    with Backlog(scribe) as happened:
        happened.add(FIRST)
        happened.add(LAST)
        if error is not None:
            raise error


def test_at_the_end_of_a_run_all_is_told():
    scribe = Scribe()
    run(scribe)
    assert scribe.told == [FIRST, LAST]


@pytest.mark.parametrize("error", [RuntimeError(), KeyboardInterrupt()])
def test_what_led_to_a_failure_is_told_too_and_the_failure_goes_on(error: BaseException):
    scribe = Scribe()
    with pytest.raises(type(error)):
        run(scribe, error)
    assert scribe.told == [FIRST, LAST]


def test_a_full_disk_is_an_error_but_does_not_hide_another():
    with pytest.raises(RecordingError):
        run(Scribe(room=1))
    with pytest.raises(RuntimeError):
        run(Scribe(room=1), RuntimeError())


def test_nothing_more_is_told_once_the_disk_was_full():
    scribe = Scribe()
    with pytest.raises(RecordingError):
        run(scribe, RecordingError())
    assert scribe.told == []


def test_while_there_is_time_the_last_few_wait_for_what_comes_and_are_told_when_asked(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(backlog, "_LONGEST", math.inf)
    scribe = Scribe(room=1000)
    happened = Backlog(scribe)
    events = [Sampled(0, float(t)) for t in range(300)]
    for event in events:
        happened.add(event)
        happened.write_most()
    assert scribe.expected == events
    assert scribe.told == events[: len(scribe.told)]
    assert 1 < len(happened) == 300 - len(scribe.told) < 150
    happened.write_down()
    assert scribe.told == events


def test_an_event_waits_no_longer_than_a_moment_for_others(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(backlog, "_LONGEST", 0.0)
    scribe = Scribe()
    happened = Backlog(scribe)
    happened.add(FIRST)
    happened.write_most()
    assert scribe.told == [FIRST]


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
    class Broken(Scribe):
        def witness(self, event: Event) -> None:
            raise DivergedError("h_tot", 0.0)

    with pytest.raises(KeyboardInterrupt):
        run(Broken(), KeyboardInterrupt())
