"""An agent of the run can change nothing but its own answers, and a stranger nothing at all."""

from pathlib import Path

import pytest

from phalanx.faults.commands import CommandPolicy
from phalanx.guarantee.verdict import Summary
from tests.hostile.attacker import INSIDERS, READ, STRANGERS, is_at_full_speed
from tests.process.hostile.attacks import assailed
from tests.process.runs import HELD, PACED

pytestmark = pytest.mark.swarm

IN_HIS_OWN_NAME = "in his own name"


FLOODS = [name for name in INSIDERS if is_at_full_speed(name)]
OTHERS = [name for name in INSIDERS if name not in FLOODS]
IN_OTHERS_NAMES = [name for name in FLOODS if IN_HIS_OWN_NAME not in name]
IN_HIS_NAME = [name for name in FLOODS if IN_HIS_OWN_NAME in name]
GROUPS = {
    "no floods": pytest.param(OTHERS, HELD, marks=pytest.mark.nightly),
    "floods": pytest.param(IN_OTHERS_NAMES, HELD, marks=pytest.mark.nightly),
    # One that is let in may drown the command that lets a held run go.
    "floods in his own name": pytest.param(IN_HIS_NAME, PACED, marks=pytest.mark.nightly),
}


@pytest.mark.parametrize(("attacks", "policy"), GROUPS.values(), ids=GROUPS)
def test_insiders_change_nothing(
    attacks: list[str], policy: CommandPolicy, calm: Summary, tmp_path: Path
) -> None:
    """All of a group at once: the hub keeps each from speaking for others."""
    summary, attackers = assailed(attacks, tmp_path / "assailed", policy)
    actual, expected = (summary.trajectory, summary.outcome), (calm.trajectory, calm.outcome)
    assert actual == expected, summary.reason
    assert [name for name, each in attackers.items() if not each.let_in] == []


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
