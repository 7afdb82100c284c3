"""An agent of the run can change nothing but its own answers."""

import pytest

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.scenario.load import load
from tests.hostile.attacker import INSIDERS
from tests.hostile.attacker import SCENARIO as NAME
from tests.process.hostile.attacks import assailed
from tests.process.runs import HELD, PACED

pytestmark = pytest.mark.swarm

IN_HIS_OWN_NAME = "in his own name"
WITHHOLDING = 'agents.0.law={ type = "tests.hostile.withholding:Withholding" }'


@pytest.mark.parametrize("attack", INSIDERS)
def test_an_insider_changes_nothing(attack: str, calm: Summary, tmp_path) -> None:
    # A flood that is let in may drown the command that lets a held run go.
    policy = PACED if IN_HIS_OWN_NAME in attack else HELD
    summary, attacker = assailed(attack, tmp_path / "assailed", policy)
    found, expected = (summary.trajectory, summary.outcome), (calm.trajectory, calm.outcome)
    assert found == expected, summary.reason
    assert attacker.let_in


def test_one_who_withholds_a_broadcast_is_named_with_who_waits_for_it(tmp_path) -> None:
    scenario = load(NAME, ["duration=0.5", "time.timeout=5.0", WITHHOLDING])
    summary = execute(scenario, tmp_path, RunOptions())
    said = "agent 1 waits at sample 11 for what others put: broadcast 10 of agent 3 did not come"
    assert summary.outcome is Outcome.BROKEN
    assert said in summary.reason
    assert said in (tmp_path / "logs" / "1.log").read_text()
