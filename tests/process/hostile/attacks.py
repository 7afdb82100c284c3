"""Attackers' processes during a run, from its beginning to its end."""

import subprocess
import sys
import threading
from collections.abc import Iterable
from pathlib import Path

from phalanx.faults.commands import CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.scenario.load import load
from phalanx.wire.session import free_endpoint
from tests.hostile.attacker import OVERRIDES, UNDER_WAY
from tests.hostile.attacker import SCENARIO as NAME
from tests.process.runs import HELD, SECRET, live_run, wait_for

SCENARIO = load(NAME, OVERRIDES)
ROOT = Path(__file__).parents[3]


class AttackUnderWay:
    """An attacker, and what it has printed so far."""

    def __init__(self, attack: str, endpoint: str, run: str) -> None:
        command = [sys.executable, "-m", "tests.hostile.attacker", attack, endpoint, run]
        if attack.startswith("insider"):
            command.append(SECRET.hex())
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=ROOT, bufsize=1
        )
        self.lines: list[str] = []
        self._listening = threading.Thread(target=self._listen)
        self._listening.start()

    def _listen(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.append(line.strip())

    @property
    def let_in(self) -> bool | None:
        """Return whether the hub opened a session for it; None before that is known."""
        return None if len(self.lines) < 2 else self.lines[1] == UNDER_WAY

    def end(self) -> None:
        """Kill it."""
        self.process.kill()
        self.process.wait()
        self._listening.join()


def assailed(
    attacks: Iterable[str], folder: Path, policy: CommandPolicy = HELD
) -> tuple[Summary, dict[str, AttackUnderWay]]:
    """Run a scenario under attack by processes that wait for its hub to listen.

    By default the run stands nearly still until every attack is under way, or refused.
    """
    endpoint = free_endpoint()
    attackers: dict[str, AttackUnderWay] = {}
    try:
        for attack in attacks:
            attackers[attack] = AttackUnderWay(attack, endpoint, folder.name)
        wait_for(lambda: all(attacker.lines for attacker in attackers.values()))
        with live_run(SCENARIO, folder, policy, endpoint) as run:
            if policy is HELD:
                wait_for(
                    lambda: all(attacker.let_in is not None for attacker in attackers.values())
                )
                run.set_speed(0.2)
            return run.summary(), attackers
    finally:
        for attacker in attackers.values():
            attacker.end()
