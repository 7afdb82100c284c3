"""Run every attack against a run of real processes and write the table of docs/security.md.

python bench/attacks/table.py            all of them, each beside a run of its own
python bench/attacks/table.py stranger   those whose name contains the word; the other rows stay
"""

import secrets
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

import certified
from attacker import ATTACKS, OVERRIDES, READ, SCENARIO, UNDER_WAY

import phalanx
from phalanx.faults.commands import CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.execute import execute
from phalanx.wire.endpoints import free_endpoint

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- made by bench/attacks/table.py -->", "<!-- end -->"
PAGE = ROOT / "docs" / "security.md"
HEAD = ("| who and what | outcome | refused | wall time [s] |", "|---|---|---|---|")
SPEED = 0.1
"""Virtual seconds for each of wall time: every attack gets some five seconds of the run."""


class Outcome(NamedTuple):
    """What an attack came to."""

    let_in: bool
    read: int
    summary: Summary


def attacked(attack: str, scenario: phalanx.Scenario) -> Outcome:
    """A run beside an attacker who waits for its hub to listen."""
    secret, endpoint = secrets.token_bytes(16), free_endpoint()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "assailed"
        folder.mkdir()
        command = [sys.executable, "-m", "bench.attacks.attacker", attack, endpoint, folder.name]
        if attack.startswith("insider"):
            command.append(secret.hex())
        attacker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert attacker.stdout
        said = [attacker.stdout.readline()]
        listening = threading.Thread(
            target=lambda lines: said.extend(lines), args=(attacker.stdout,)
        )
        listening.start()
        try:
            policy = CommandPolicy(speed=SPEED)
            summary = execute(scenario, folder, commands=policy, listen=endpoint, secret=secret)
        finally:
            attacker.kill()
            attacker.wait()
            listening.join()
    return _outcome(said, summary)


def attacked_with_certificates(attack: str) -> Outcome:
    """A run whose hub asks for certificates, beside such an attacker."""
    return _outcome(*certified.attacked(attack))


def _outcome(said: list[str], summary: Summary) -> Outcome:
    lines = [line.strip() for line in said]
    return Outcome(UNDER_WAY in lines, lines.count(READ), summary)


def row(attack: str, outcome: Outcome, calm: Summary, wall_time: float) -> str:
    """A row of the table."""
    summary = outcome.summary
    same = "same" if summary.trajectory == calm.trajectory else "another"
    refused = ", ".join(f"{n} {reason}" for reason, n in summary.rejected.items())
    if not outcome.let_in:
        refused = "at the door"
    if outcome.read:
        refused = f"{refused}; it read {outcome.read} messages"
    cells = (
        attack,
        f"{summary.outcome}, {same} trajectory",
        refused or "nothing came through",
        f"{wall_time:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print rows as they come, and put them into the page's table."""
    every = (*ATTACKS, *certified.CERTIFIED, *certified.HUBS)
    chosen = [name for name in every if all(word in name for word in sys.argv[1:])]
    scenario = phalanx.load(SCENARIO, OVERRIDES)
    calm = phalanx.run(scenario, engine="in-process").summary
    assert calm is not None
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    old, _, after = rest.partition(END)
    rows = {line.split(" | ")[0].strip("| "): line for line in old.splitlines()}
    for attack in chosen:
        began = time.monotonic()
        if attack in ATTACKS:
            outcome = attacked(attack, scenario)
        else:
            outcome = attacked_with_certificates(attack)
        rows[attack] = row(attack, outcome, calm, time.monotonic() - began)
        print(rows[attack], flush=True)
        if outcome.summary.outcome == "broken":
            print(outcome.summary.reason)
    table = "\n".join([BEGIN, *HEAD, *[rows[name] for name in every if name in rows], END])
    PAGE.write_text(f"{before}{table}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
