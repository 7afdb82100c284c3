"""A program without the run's secret can change nothing in a run."""

import pytest

from phalanx.guarantee.verdict import Summary
from tests.hostile.attacker import READ, STRANGERS
from tests.process.hostile.attacks import assailed

pytestmark = pytest.mark.swarm

# To be let in is no harm by itself: it only opens a connection, and says nothing.
NO_SESSION_NEEDED = {"stranger: holds 200 connections half-open"}


@pytest.mark.parametrize("attack", STRANGERS)
def test_a_stranger_changes_nothing(attack: str, calm: Summary, tmp_path) -> None:
    summary, attacker = assailed(attack, tmp_path / "assailed")
    assert (summary.trajectory, summary.outcome) == (calm.trajectory, calm.outcome)
    assert READ not in attacker.said
    assert attacker.let_in == (attack in NO_SESSION_NEEDED)
