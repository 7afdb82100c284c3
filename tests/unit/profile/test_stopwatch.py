"""The stopwatch on a clock of the test's own making: calls take as long as they say."""

from pathlib import Path

import pytest

from phalanx.messages import profile as module
from phalanx.messages.profile import Stopwatch, read_profile


class Clock:
    """A wall clock that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


class Work:
    """Calls that take a while."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock

    def inner(self, seconds: float) -> str:
        self.clock.now += seconds
        return "done"

    def outer(self, before: float, *, within: float) -> str:
        self.clock.now += before
        return self.inner(within)

    def fails(self) -> None:
        self.clock.now += 4.0
        raise LookupError


@pytest.fixture
def work(monkeypatch) -> Work:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return Work(clock)


def test_a_timed_call_within_another_is_taken_out_of_it(work: Work):
    stopwatch = Stopwatch()
    stopwatch.time(work, "outer", "compute")
    stopwatch.time(work, "inner", "message")
    assert work.outer(1.0, within=0.25) == "done"
    work.clock.now += 10.0
    assert work.inner(0.5) == "done"
    spent = stopwatch.spent("agent")
    assert spent.phases == {"compute": 1.0, "message": 0.75}
    assert spent.calls == {"compute": 1, "message": 2}
    assert spent.wall == 11.75


def test_two_calls_may_be_of_one_phase(work: Work):
    stopwatch = Stopwatch()
    stopwatch.time(work, "outer", "wait")
    stopwatch.time(work, "inner", "wait")
    work.outer(1.0, within=0.25)
    assert stopwatch.spent("plant").phases == {"wait": 1.25}


def test_a_call_that_raises_is_counted_and_raises(work: Work):
    stopwatch = Stopwatch()
    stopwatch.time(work, "fails", "judge")
    with pytest.raises(LookupError):
        work.fails()
    assert stopwatch.spent("plant").phases == {"judge": 4.0}


def test_an_object_that_is_not_timed_is_left_as_it_is(work: Work):
    Stopwatch().time(Work(work.clock), "inner", "compute")
    assert "inner" not in vars(work)


def test_what_was_counted_is_read_back_by_program(work: Work, tmp_path: Path):
    assert read_profile(tmp_path / "profile") == []
    stopwatch = Stopwatch()
    stopwatch.time(work, "inner", "compute")
    stopwatch.write(tmp_path / "profile", "2")
    work.inner(0.5)
    stopwatch.write(tmp_path / "profile", "1")
    first, second = read_profile(tmp_path / "profile")
    assert (first.program, first.wall, first.phases) == ("1", 0.5, {"compute": 0.5})
    assert (second.program, second.wall, second.phases) == ("2", 0.0, {})
