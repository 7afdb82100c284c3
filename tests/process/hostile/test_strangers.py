"""A program without the run's secret can change nothing in a run."""

import pytest

from phalanx.guarantee.verdict import Summary
from tests.hostile.attacker import READ, STRANGERS
from tests.process.hostile.attacks import assailed

pytestmark = pytest.mark.swarm

NEEDS_NO_SESSION = "stranger: holds 200 connections half-open"
"""It is let in, which is no harm by itself: it only opens connections, and says nothing."""


def test_strangers_are_refused_and_change_nothing(calm: Summary, tmp_path) -> None:
    """All at once: each is refused by itself, and says so."""
    summary, attackers = assailed(STRANGERS.keys() - {NEEDS_NO_SESSION}, tmp_path / "assailed")
    assert (summary.trajectory, summary.outcome) == (calm.trajectory, calm.outcome)
    for name, attacker in attackers.items():
        assert READ not in attacker.lines, name
        assert not attacker.let_in, name


def test_connections_held_half_open_change_nothing(calm: Summary, tmp_path) -> None:
    summary, attackers = assailed([NEEDS_NO_SESSION], tmp_path / "assailed")
    assert (summary.trajectory, summary.outcome) == (calm.trajectory, calm.outcome)
    assert attackers[NEEDS_NO_SESSION].let_in
