"""Ctrl-C: remembered until it is answered, and raised where it breaks into nothing."""

import os
import signal
from collections.abc import Iterator

import pytest

from phalanx.launcher import interrupt


@pytest.fixture(autouse=True)
def remembered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(interrupt, "_sigterm", False)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupt.install()
    yield
    interrupt.clear()
    for number, handler in before.items():
        signal.signal(number, handler)


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_it_ends_what_runs_and_is_not_forgotten_if_that_drops_it() -> None:
    with pytest.raises(KeyboardInterrupt):
        press()
    with pytest.raises(KeyboardInterrupt):
        interrupt.raise_pending()
    interrupt.clear()
    interrupt.raise_pending()


def test_held_back_it_is_raised_where_it_is_asked_for() -> None:
    with interrupt.deferred():
        press()
        press()
        with pytest.raises(KeyboardInterrupt):
            interrupt.raise_pending()
    with pytest.raises(KeyboardInterrupt):
        press()


def test_held_back_twice_it_stays_so_until_both_are_over() -> None:
    with interrupt.deferred():
        with interrupt.deferred():
            pass
        press()
    with pytest.raises(KeyboardInterrupt):
        press()


def test_who_was_started_in_the_background_goes_on() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    interrupt.install()
    press()
    interrupt.raise_pending()


def test_let_in_it_breaks_in_and_so_does_one_that_came_before() -> None:
    with interrupt.deferred():
        with pytest.raises(KeyboardInterrupt), interrupt.interruptible():
            press()
        with pytest.raises(KeyboardInterrupt), interrupt.interruptible():
            pass
        press()


def test_a_sigterm_is_one_too() -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        interrupt.raise_pending()
    assert interrupt.sigterm_received()
