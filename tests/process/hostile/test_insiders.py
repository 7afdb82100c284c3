"""What an agent of the run does to a run beside what it answers: nothing."""

import pytest

from bench.attacks.attacker import INSIDERS
from phalanx.guarantee.verdict import Summary
from tests.process.hostile.attacks import assailed
from tests.process.runs import HELD, PACED

pytestmark = pytest.mark.swarm

IN_HIS_OWN_NAME = "in his own name"


@pytest.mark.parametrize("attack", INSIDERS)
def test_an_insider_changes_nothing(attack: str, calm: Summary, tmp_path) -> None:
    # A flood that is let in may drown the command that lets a held run go.
    policy = PACED if IN_HIS_OWN_NAME in attack else HELD
    summary, attacker = assailed(attack, tmp_path / "assailed", policy)
    found, expected = (summary.trajectory, summary.outcome), (calm.trajectory, calm.outcome)
    assert found == expected, summary.reason
    assert attacker.let_in
