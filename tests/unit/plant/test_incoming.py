"""The plant's queue is bounded, and refusals are counted without filling the log."""

import logging
import queue

import pytest
from phalanx_plant.hub.session import _MOST, IncomingQueue

from phalanx.messages.kinds import MAX_BYTES
from phalanx.messages.seal import Malformed, Refusals
from tests.unit.plant.signals import outlasting_a_wait

ANSWER = b"the answer"
KEY, OTHER = "phalanx/r/actuation/1", "phalanx/r/actuation/2"
LOG = logging.getLogger("phalanx.test")


@pytest.fixture
def refusals() -> Refusals:
    return Refusals(LOG)


@pytest.fixture
def incoming(refusals) -> IncomingQueue:
    return IncomingQueue((KEY, OTHER), refusals, require_pending)


def require_pending(_: str, payload: bytes) -> None:
    if payload != ANSWER:
        raise Malformed("bad seal")


def drain(incoming: IncomingQueue) -> list[tuple[str, bytes | bool]]:
    messages = []
    while True:
        try:
            messages.append(incoming.get(timeout=0.0))
        except queue.Empty:
            return messages


def flood(incoming: IncomingQueue, times: int = 1) -> None:
    """Put as many payloads as may wait, so many times."""
    for _ in range(times * _MOST):
        incoming.put_payload(KEY, b"?")


def test_a_flood_is_bounded_and_leaves_room_for_others(incoming, refusals):
    flood(incoming, 10)
    incoming.put_payload(OTHER, b"!")
    incoming.put_token("phalanx/r/alive/1/d", False)
    assert drain(incoming) == [
        *[(KEY, b"?")] * _MOST,
        (OTHER, b"!"),
        ("phalanx/r/alive/1/d", False),
    ]
    assert refusals.counts == {"bad seal": 9 * _MOST}


def test_a_flood_does_not_drown_an_answer_that_is_awaited(incoming, refusals):
    for _ in range(10):
        flood(incoming)
        incoming.put_payload(KEY, ANSWER)
    assert drain(incoming).count((KEY, ANSWER)) == 10
    for _ in range(10 * _MOST):
        incoming.put_payload(KEY, ANSWER)
    assert len(drain(incoming)) == 2 * _MOST
    assert refusals.counts == {"bad seal": 9 * _MOST, "too many": 8 * _MOST}


def test_there_is_room_again_for_what_was_taken(incoming, refusals):
    for _ in range(3):
        flood(incoming)
        assert len(drain(incoming)) == _MOST
    assert refusals.counts == {}


@pytest.mark.parametrize(
    "key", ["**", "phalanx/r/**", "phalanx/r/actuation/*", "phalanx/r/actuation/3", ""]
)
def test_under_any_other_key_nothing_comes(incoming, refusals, key):
    incoming.put_payload(key, b"?")
    assert drain(incoming) == []
    assert refusals.counts == {"unknown sender": 1}


def test_what_is_too_large_does_not_wait(incoming, refusals):
    incoming.put_payload(KEY, bytes(MAX_BYTES + 1))
    assert drain(incoming) == []
    assert refusals.counts == {"oversized": 1}


def test_a_signal_that_outlasts_a_wait_leaves_it_its_end(incoming):
    with outlasting_a_wait(lambda: incoming.put_token("at last", True)), pytest.raises(queue.Empty):
        incoming.get(timeout=0.03)


def test_a_hundred_thousand_refusals_are_six_lines(refusals, caplog):
    with caplog.at_level(logging.WARNING, LOG.name):
        for _ in range(10**5):
            refusals.add(KEY, "bad seal")
        refusals.add(KEY, "truncated")
    assert refusals.counts == {"bad seal": 10**5, "truncated": 1}
    assert len(caplog.records) == 7
    assert "bad seal (100000 so far)" in caplog.text
