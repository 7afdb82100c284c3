"""Runs in real time over a real wire that is slow, loses packets, and is cut for three seconds."""

from pathlib import Path

import pytest

from phalanx.guarantee.verdict import Outcome
from tests.network.broadcast_statistics import Statistics, longest_silence, statistics
from tests.network.testbed import DELAY, JITTER, SETTLED, lossy, opened, partitioned, unavailable

pytestmark = [
    pytest.mark.swarm,
    pytest.mark.nightly,
    pytest.mark.skipif(reason := unavailable() or False, reason=str(reason)),
]


def over(protocol: str, loss: float, out: Path) -> Statistics:
    """Ten seconds, from when packets are lost."""
    with opened() as bed:
        recording = lossy(bed, protocol, loss, SETTLED + 11.0, out)
    assert recording.summary.outcome in (Outcome.SAFE, Outcome.VIOLATED)
    return statistics(recording, SETTLED, SETTLED + 10.0)


def test_what_tcp_loses_comes_later(tmp_path: Path) -> None:
    link = over("tcp", 0.05, tmp_path)
    assert link.sent > 100
    assert link.loss == 0.0
    median, slow = link.delay
    assert median > DELAY - JITTER
    assert slow > 4.0 * DELAY, "a packet sent again takes its time, and all behind it wait"


def test_what_udp_loses_is_lost(tmp_path: Path) -> None:
    found = over("udp", 0.1, tmp_path)
    assert found.sent > 100
    assert 0.02 < found.loss < 0.4
    assert found.delay[0] > DELAY - JITTER


def test_a_run_heals_when_the_wire_does(tmp_path: Path) -> None:
    with opened() as bed:
        recording = partitioned(bed, 15.0, tmp_path)
    assert recording.summary.outcome in (Outcome.SAFE, Outcome.VIOLATED)
    silent, heard = longest_silence(recording)
    assert heard - silent > 2.5
    agents = {step.agent for step in recording.steps if step.t > heard + 1.0}
    assert agents == {"1", "2", "3", "4", "5"}
