"""Run every attack against a run of real processes and write the table of docs/security.md.

python evidence/attacks/table.py            all of them, each beside a run of its own
python evidence/attacks/table.py stranger   those whose name contains the word; the other rows stay
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
import readers

import phalanx
from phalanx.faults.commands import CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.wire.session import free_endpoint
from tests.hostile.attacker import ATTACKS, OVERRIDES, READ, SCENARIO, UNDER_WAY

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- made by evidence/attacks/table.py -->", "<!-- end -->"
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
        command = [sys.executable, "-m", "tests.hostile.attacker", attack, endpoint, folder.name]
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
            options = RunOptions(commands=policy, listen=endpoint, secret=secret)
            summary = execute(scenario, folder, options)
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
    same = "same trajectory" if summary.trajectory == calm.trajectory else "another trajectory"
    if summary.punctuality is not None:
        kept = summary.punctuality
        same = f"{kept.missed} of {kept.samples + kept.missed} samples missed"
    refused = ", ".join(f"{n} {reason}" for reason, n in summary.rejected.items())
    if not outcome.let_in:
        refused = "at the door"
    if outcome.read:
        refused = f"{refused}; it read {outcome.read} messages"
    cells = (
        attack,
        f"{summary.outcome}, {same}",
        refused or "nothing came through",
        f"{wall_time:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def calm_run(scenario: phalanx.Scenario) -> Summary:
    """What a run comes to that nobody attacks."""
    summary = phalanx.run(scenario, engine="in-process").summary
    assert summary is not None
    return summary


def main() -> None:
    """Print rows as they come, and put them into the page's table."""
    every = (*ATTACKS, *readers.READERS, *certified.CERTIFIED, *certified.HUBS)
    chosen = [name for name in every if all(word in name for word in sys.argv[1:])]
    scenario = phalanx.load(SCENARIO, OVERRIDES)
    undisturbed = calm_run(scenario)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    old, _, after = rest.partition(END)
    rows = {line.split(" | ")[0].strip("| "): line for line in old.splitlines()}
    for attack in chosen:
        began = time.monotonic()
        calm = undisturbed
        if attack in ATTACKS:
            outcome = attacked(attack, scenario)
        elif attack in readers.READERS:
            said, summary = readers.attacked(attack)
            outcome = Outcome(set(said) <= {UNDER_WAY}, 0, summary)
            calm = calm_run(readers.scenario_of(attack))
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
