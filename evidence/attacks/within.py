"""Search shipped scenarios within their bounds, and look for a verdict or a promise that is wrong.

    python evidence/attacks/within.py                        six scenarios, 100 runs of each kind
    python evidence/attacks/within.py guaranteed --budget 500

A run that ends guaranteed though a pair was unsafe, or a violation before the time for which
`phalanx check` promised safety from that start, is an error of the theory or of its code: exits
with 1. A run that is violated otherwise says that safety cannot be promised from that start.
"""

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import phalanx
from phalanx.attacks.archive import Find
from phalanx.attacks.attack import Options, attack
from phalanx.attacks.search import History

LASTS = {
    "guaranteed": 3.0,
    "unicycles": 3.0,
    "one-on-one": 1.5,
    "heading-aware": 2.0,
    "surrounded": 1.0,
    "crossing": 3.0,
}
"""Durations, cut so that a run takes about a second [s]."""


class Runs(NamedTuple):
    """The runs of one optimiser."""

    total: int
    violated: int
    wrong: int
    """Guaranteed, with h > 0."""
    uncovered: float
    """Earliest time at which a pair had no certificate [s]."""


def runs_of(history: History) -> Runs:
    """Summarise the runs of a history."""
    rows = [find.row for find in history.finds]
    wrong = sum(row.outcome == "guaranteed" and (row.worst_h or 0.0) > 0.0 for row in rows)
    lost = [math.inf if row.uncovered_at is None else row.uncovered_at for row in rows]
    violated = sum(row.outcome == "violated" for row in rows)
    return Runs(len(rows), violated, wrong, min(lost, default=math.inf))


def is_early(find: Find, path: Path) -> bool:
    """Return whether an attack is violated within what a check of its start promised."""
    when = find.row.first_violation
    return when is not None and when < phalanx.check(phalanx.load(str(path))).promised.time


def in_words(runs: Runs) -> str:
    """Return the cells of one optimiser's runs."""
    lost = "never" if math.isinf(runs.uncovered) else f"{runs.uncovered:.3f} s"
    return f"{runs.total} | {runs.violated} | {lost}"


def main() -> None:
    """Print a row for each scenario, as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="?", default="", help="part of a scenario's name")
    parser.add_argument("--budget", type=int, default=100, help="runs of each optimiser")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    print("| scenario | runs by search | violated | first without a certificate | runs at random | "
          "violated | first without a certificate | wrong | within the promise |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    errors = 0
    for name, lasts in LASTS.items():
        if asked.only not in name:
            continue
        options = Options(asked.budget, preset="within", seed=asked.seed, fresh=0)
        with tempfile.TemporaryDirectory() as folder:
            found = attack(
                name, {"duration": lasts}, options, folder=Path(folder), workers=asked.workers
            )
            searched, chance = map(runs_of, found.histories)
            too_early = sum(is_early(find, path) for _, find, path in found.finds)
        wrong = searched.wrong + chance.wrong
        errors += wrong + too_early
        print(f"| `{name}` | {in_words(searched)} | {in_words(chance)} | {wrong} | {too_early} |",
              flush=True)  # fmt: skip
    sys.exit(bool(errors))


if __name__ == "__main__":
    main()
