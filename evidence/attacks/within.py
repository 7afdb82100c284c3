"""Search shipped scenarios within their bounds, and look for a verdict or a promise that is wrong.

    python evidence/attacks/within.py                        eight scenarios, 100 runs of each kind
    python evidence/attacks/within.py guaranteed --budget 500
    python evidence/attacks/within.py --out FOLDER           keep all runs; asked again, it goes on

A run that ends guaranteed though a pair was unsafe, or a violation before the time for which
`phalanx check` promised safety from that start, is an error of the theory or of its code: exits
with 1. A run that is violated otherwise says that safety cannot be promised from that start.

A second table compares the worst run of each search with the scenario's own adversaries, over its
whole duration: the largest h_tot, and the shortest certificate in τ.
"""

import argparse
import math
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

from phalanx_attacks.archive import Find, table_of
from phalanx_attacks.knobs import Fields
from phalanx_attacks.robustness import evaluate
from phalanx_attacks.runner import DECLARATION, attack
from phalanx_attacks.search import History, Options

import phalanx
from phalanx.guarantee.start import promised
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm

LASTS = {
    "guaranteed": 3.0,
    "unicycles": 3.0,
    "one-on-one": 1.5,
    "heading-aware": 2.0,
    "surrounded": 1.0,
    "crossing": 3.0,
    "swarm2d": 4.0,
    "formation3d": 6.0,
}
"""Durations, cut to about the time in which an adversary can meet somebody [s]."""


class Runs(NamedTuple):
    """The runs of one optimiser."""

    total: int
    violated: int
    wrong: int
    """Guaranteed, with h > 0 of a pair at some recorded state."""
    uncovered: float
    """Earliest time at which a pair had no certificate [s]."""
    h: float
    """Largest h_tot."""
    shortest: float
    """Shortest certificate [τ]."""


def runs_of(history: History) -> Runs:
    """Summarise the runs of a history."""
    rows = [find.row for find in history.finds]
    lost = [math.inf if row.uncovered_at is None else row.uncovered_at for row in rows]
    h = [row.worst_h for row in rows if row.worst_h is not None]
    certified = [row.shortest for row in rows if row.shortest is not None]
    return Runs(
        total=len(rows),
        violated=sum(row.outcome == "violated" for row in rows),
        wrong=sum(f.row.outcome == "guaranteed" and f.robustness < 0.0 for f in history.finds),
        uncovered=min(lost, default=math.inf),
        h=max(h, default=-math.inf),
        shortest=min(certified, default=math.inf),
    )


def both(histories: list[History]) -> tuple[Runs, Runs]:
    """Summarise a search, and the random one."""
    searched, chance = map(runs_of, histories)
    return searched, chance


def is_early(find: Find, base: Fields) -> bool:
    """Return whether a run is violated within what a check of its start promised."""
    when = find.row.first_violation
    return when is not None and when < promised(build_swarm(load(table_of(base, find)))).time


def in_words(runs: Runs) -> str:
    """Return the cells of one optimiser's runs."""
    lost = "never" if math.isinf(runs.uncovered) else f"{runs.uncovered:.3f} s"
    return f"{runs.total} | {runs.violated} | {lost}"


def closeness(h: float, shortest: float) -> str:
    """Return the cells that say how close runs came to a violation."""
    return f"{h:.3g} | {shortest:.2f} τ"


def of_own_adversaries(name: str) -> str:
    """Run a scenario as it ships, and return how close it came."""
    summary = evaluate(phalanx.load(name)).summary
    shortest = summary.certificates.shortest
    return closeness(summary.largest_h_tot, math.inf if shortest is None else shortest)


def print_closeness(compared: dict[str, tuple[Runs, Runs]]) -> None:
    """Print how close own adversaries, a search and random runs came to a violation."""
    print()
    print("| scenario | own adversaries: largest h_tot | shortest certificate | by search: h_tot | "
          "certificate | at random: h_tot | certificate |")  # fmt: skip
    print("|---|---|---|---|---|---|---|", flush=True)
    for name, runs in compared.items():
        cells = of_own_adversaries(name), *(closeness(each.h, each.shortest) for each in runs)
        print(f"| `{name}` | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print a row for each scenario, as soon as it is known; then how close each came."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="?", default="", help="part of a scenario's name")
    parser.add_argument("--budget", type=int, default=100, help="runs of each optimiser")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    print("| scenario | runs by search | violated | first without a certificate | runs at random | "
          "violated | first without a certificate | wrong | within the promise |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    errors, compared = 0, dict[str, tuple[Runs, Runs]]()
    options = Options(arguments.budget, preset="within", seed=arguments.seed, fresh=0)
    with tempfile.TemporaryDirectory() as temporary:
        for name in filter(lambda name: arguments.only in name, LASTS):
            cut, folder = {"duration": LASTS[name]}, (arguments.out or Path(temporary)) / name
            searches = attack(name, cut, options, folder=folder, workers=arguments.workers)
            searched, chance = compared[name] = both(searches.histories)
            base = tomllib.loads((folder / DECLARATION).read_text(encoding="utf-8"))["scenario"]
            early = sum(
                is_early(find, base) for each in searches.histories for find in each.violated
            )
            wrong = searched.wrong + chance.wrong
            errors += wrong + early
            cells = f"`{name}`", in_words(searched), in_words(chance), str(wrong), str(early)
            print(f"| {' | '.join(cells)} |", flush=True)
    print_closeness(compared)
    sys.exit(bool(errors))


if __name__ == "__main__":
    main()
