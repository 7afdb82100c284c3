"""What an agent of the run does to a run in another's name: nothing; in its own, to itself."""

import pytest

from bench.attacks.attacker import INSIDER, INSIDERS
from phalanx.guarantee.verdict import Outcome, Summary
from tests.process.hostile.attacks import assailed
from tests.process.runs import HELD, PACED

pytestmark = pytest.mark.swarm

FLOOD = "insider: floods a peer in his own name"
AT_ITS_OWN_COST = "insider: floods the plant in his own name"


@pytest.mark.parametrize("attack", [name for name in INSIDERS if name != AT_ITS_OWN_COST])
def test_an_insider_changes_nothing(attack: str, calm: Summary, tmp_path) -> None:
    # A flood that is let in may drown the command that lets a held run go.
    policy = PACED if attack == FLOOD else HELD
    summary, attacker = assailed(attack, tmp_path / "assailed", policy)
    found, expected = (summary.trajectory, summary.outcome), (calm.trajectory, calm.outcome)
    assert found == expected, summary.reason
    assert attacker.let_in


def test_one_who_drowns_its_own_answers_is_named(calm: Summary, tmp_path) -> None:
    """Unless they come through all the same: then nothing has changed."""
    summary, attacker = assailed(AT_ITS_OWN_COST, tmp_path / "assailed", PACED)
    assert attacker.let_in
    if summary.outcome is Outcome.BROKEN:
        # Its input drowns, or its report on it.
        assert summary.reason.startswith(f"agent {INSIDER} did not ")
    else:
        assert (summary.trajectory, summary.outcome) == (calm.trajectory, calm.outcome)
    assert summary.rejected["too many"] > 0
