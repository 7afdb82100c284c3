"""What an agent of the run does to a run in another's name: nothing."""

import pytest

from bench.attacks.attacker import INSIDERS
from phalanx.guarantee.verdict import Summary
from tests.process.hostile.attacks import assailed

pytestmark = pytest.mark.swarm


@pytest.mark.parametrize("attack", INSIDERS)
def test_an_insider_changes_nothing(attack: str, calm: Summary, tmp_path) -> None:
    summary, attacker = assailed(attack, tmp_path / "assailed")
    assert (summary.trajectory, summary.outcome) == (calm.trajectory, calm.outcome)
    assert attacker.let_in
