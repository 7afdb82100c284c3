"""Ctrl-C: remembered until it is answered, and raised where it breaks into nothing."""

import os
import signal
from collections.abc import Iterator

import pytest

from phalanx.launcher import interrupt


@pytest.fixture(autouse=True)
def remembered() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    interrupt.remember()
    yield
    interrupt.answer()
    signal.signal(signal.SIGINT, before)


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_it_ends_what_runs_and_is_not_forgotten_if_that_drops_it() -> None:
    with pytest.raises(KeyboardInterrupt):
        press()
    with pytest.raises(KeyboardInterrupt):
        interrupt.raise_unanswered()
    interrupt.answer()
    interrupt.raise_unanswered()


def test_held_back_it_is_raised_where_it_is_asked_for() -> None:
    with interrupt.held_back():
        press()
        press()
        with pytest.raises(KeyboardInterrupt):
            interrupt.raise_unanswered()
    with pytest.raises(KeyboardInterrupt):
        press()


def test_who_was_started_in_the_background_goes_on() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    interrupt.remember()
    press()
    interrupt.raise_unanswered()
