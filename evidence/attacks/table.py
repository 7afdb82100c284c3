"""Run every attack against a run of real processes and write the table of results.md.

python evidence/attacks/table.py            all of them, each on a run of its own
python evidence/attacks/table.py stranger   those whose name contains the word; the others stay
"""

import secrets
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Mapping
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
PAGE = Path(__file__).with_name("results.md")
HEAD = ("| who | attacks | outcome | refused |", "|---|---|---|---|")
SPEED = 0.1
"""Virtual seconds for each of wall time: every attack gets some five seconds of the run."""


class Outcome(NamedTuple):
    """The result of an attack."""

    let_in: bool
    read: int
    summary: Summary


def attacked(attack: str, scenario: phalanx.Scenario) -> Outcome:
    """Run with an attacker, which waits for the hub to listen."""
    secret, endpoint = secrets.token_bytes(16), free_endpoint()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "assailed"
        folder.mkdir()
        command = [sys.executable, "-m", "tests.hostile.attacker", attack, endpoint, folder.name]
        if attack.startswith("insider"):
            command.append(secret.hex())
        attacker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert attacker.stdout
        lines = [attacker.stdout.readline()]
        listening = threading.Thread(target=lines.extend, args=(attacker.stdout,))
        listening.start()
        try:
            policy = CommandPolicy(speed=SPEED)
            options = RunOptions(commands=policy, listen=endpoint, secret=secret)
            summary = execute(scenario, folder, options)
        finally:
            attacker.kill()
            attacker.wait()
            listening.join()
    return _outcome(lines, summary)


def attacked_with_certificates(attack: str) -> Outcome:
    """Run such an attack on a hub that requires certificates."""
    return _outcome(*certified.attacked(attack))


def _outcome(printed: list[str], summary: Summary) -> Outcome:
    lines = [line.strip() for line in printed]
    return Outcome(UNDER_WAY in lines, lines.count(READ), summary)


def result(outcome: Outcome, calm: Summary) -> str:
    """The last two cells of an attack's row."""
    summary = outcome.summary
    same = summary.trajectory == calm.trajectory
    effect = f"{summary.outcome}, {'same' if same else 'another'} trajectory"
    if same and summary.outcome == calm.outcome:
        effect = "unchanged"
    if summary.punctuality is not None:
        missed, samples = summary.punctuality.missed, summary.punctuality.samples
        effect = f"{summary.outcome}, {missed} of {samples + missed} samples missed"
    refused = ", ".join(f"{n} {reason}" for reason, n in summary.rejected.items())
    if not outcome.let_in:
        refused = "not admitted"
    if outcome.read:
        refused = f"{refused}; it read {outcome.read} messages"
    return f"{effect} | {refused or 'none'}"


def read_table(lines: Iterable[str]) -> dict[str, str]:
    """The result of each attack in a table that was printed before."""
    results = {}
    for line in lines:
        attacker, attacks, last = line.strip("| ").split(" | ", 2)
        results.update({f"{attacker}: {attack}": last for attack in attacks.split("; ")})
    return results


def table_of(results: Mapping[str, str]) -> list[str]:
    """Rows of the table: attacks of one attacker with one result share a row."""
    rows: dict[tuple[str, str], list[str]] = {}
    for name, last in results.items():
        attacker, _, attack = name.partition(": ")
        rows.setdefault((attacker, last), []).append(attack)
    return [
        f"| {attacker} | {'; '.join(attacks)} | {last} |"
        for (attacker, last), attacks in rows.items()
    ]


def calm_run(scenario: phalanx.Scenario) -> Summary:
    """Return the summary of a run without an attack."""
    summary = phalanx.run(scenario, engine="in-process").summary
    assert summary is not None
    return summary


def main() -> None:
    """Print each result as it comes, and write the page's table."""
    every = (*ATTACKS, *readers.READERS, *certified.CERTIFIED, *certified.HUBS)
    chosen = [name for name in every if all(word in name for word in sys.argv[1:])]
    scenario = phalanx.load(SCENARIO, OVERRIDES)
    undisturbed = calm_run(scenario)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    old, _, after = rest.partition(END)
    results = read_table(old.strip().splitlines()[len(HEAD) :])
    for attack in chosen:
        calm = undisturbed
        if attack in ATTACKS:
            outcome = attacked(attack, scenario)
        elif attack in readers.READERS:
            lines, summary = readers.attacked(attack)
            outcome = Outcome(set(lines) <= {UNDER_WAY}, 0, summary)
            calm = calm_run(readers.scenario_of(attack))
        else:
            outcome = attacked_with_certificates(attack)
        results[attack] = result(outcome, calm)
        print(attack, results[attack], sep=" | ", flush=True)
        if outcome.summary.outcome == "broken":
            print(outcome.summary.reason)
    ordered = {name: results[name] for name in every if name in results}
    table = "\n".join([BEGIN, *HEAD, *table_of(ordered), END])
    PAGE.write_text(f"{before}{table}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
