"""What is still to be written down when a run ends, however it ends."""

import pytest

from phalanx.plant.clock.backlog import Backlog
from phalanx.plant.events.events import Event, Sampled
from phalanx.recording.write import RecordingError

FIRST, LAST = Sampled(0, 0.0), Sampled(1, 0.01)


class Scribe:
    def __init__(self, room: int = 9) -> None:
        self.told = list[Event]()
        self._room = room

    def witness(self, event: Event) -> None:
        if len(self.told) == self._room:
            raise RecordingError("the disk is full")
        self.told.append(event)

    def idle(self) -> None: ...


def run(scribe: Scribe, error: BaseException | None = None) -> None:
    with Backlog(scribe) as happened:
        happened += [FIRST, LAST]
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
