"""Search swarms that are known to be weak, and count the runs to the first violation.

python evidence/attacks/weak.py                   all swarms, 10 searches each, of 100 runs at most
python evidence/attacks/weak.py --budget 500      with another number of runs
python evidence/attacks/weak.py stale --seeds 3   one swarm, with three searches
python evidence/attacks/weak.py --out FOLDER      keep all runs there; asked again, it goes on

Each search, by CMA-ES and at random, ends with the generation of its first violated run. The
attack that the first successful search found is shrunk: its number of values, before and after.
"""

import argparse
import statistics
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
from phalanx_attacks.minimise import smallest
from phalanx_attacks.runner import Attacked, attack
from phalanx_attacks.search import History, Options

from phalanx.extend import IntegratedMargin, PairRow
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.load import read_table, scenario_text, set_field

HALF = {"type": "weak:HalfMargin"}
AROUND = [[-2.0, 10.0], [-6.0, 6.0], [-3.14, 3.14]]
"""Starts of a unicycle around one at (4, 0)."""


@dataclass(frozen=True)
class HalfMargin(IntegratedMargin):
    """Half of what is proven."""

    def at_sample(self, row: PairRow) -> ca.SX:
        """Return the margin at the sampled state."""
        return 0.5 * super().at_sample(row)


def one_on_one(name: str, duration: float = 3.0, **fields: Any) -> dict[str, Any]:
    """Keep agents 1 and 4 of Simulation 1: one unicycle, and a pursuer 6 m away or more.

    From there chance seldom breaks it; from 3 m on, one start in twenty is violated.
    """
    table = read_table(name)
    normal, pursuer = table["agents"]
    table["agents"] = [
        {**normal, "names": ["1"], "slots": [0]},
        {**pursuer, "names": ["4"], "slots": [2]},
    ]
    gain = {"agents.1.law.gain": {"log-uniform": [1.0, 25.0]}}
    table["attack"] = {"starts": {"4": AROUND}, "vary": gain, "apart": 6.0}
    for path, value in {"duration": duration, **fields}.items():
        set_field(table, path, value)
    return table


def lies() -> dict[str, Any]:
    """Take three agents that count on inputs in flight; one may lie."""
    table = read_table("faults/lie-input")
    del table["faults"]
    faults = {"most": 1, "kinds": ["lie"]}
    table["attack"] = {"faults": faults, "certified": 1.0}
    return table


def turned() -> dict[str, Any]:
    """Take two agents that keep a half each, and let one of them turn adversary."""
    table = read_table("guaranteed")
    table["agents"] = [{**table["agents"][0], "names": ["1", "2"], "slots": [0, 1]}]
    faults = {"most": 1, "kinds": ["turn"]}
    table["attack"] = {"faults": faults, "starts": {"2": AROUND}}
    return {**table, "duration": 3.0}


def stale() -> dict[str, Any]:
    """Take two agents that count on outdated inputs, 1.2 m apart or more, with some delay."""
    table = read_table("stale-inputs")
    table["attack"] = {
        "starts": {"2": [[0.6, 3.0], [-2.0, 2.0]]},
        "vary": {"network.delay": {"uniform": [0.0, 0.2]}},
    }
    return {**table, "duration": 1.0}


SWARMS: dict[str, Callable[[], dict[str, Any]]] = {
    "stale inputs: paper": stale,
    "no margin: unicycles, η = 0": lambda: one_on_one("unicycles", **{"safety.eta": 0.0}),
    "half the margin: guaranteed": lambda: one_on_one("guaranteed", 3.0, **{"safety.margin": HALF}),
    "proven margin: guaranteed": lambda: one_on_one("guaranteed"),
    "lies: in-flight": lies,
    "a normal agent turns: split": turned,
}
"""Swarms, each by a name; those that take the fewest runs first."""


def searched(table: dict[str, Any], options: Options, folder: Path) -> Attacked:
    """Search a swarm, and search it at random."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "swarm.toml"
    path.write_text(scenario_text(table), encoding="utf-8")
    with ThreadPoolExecutor(1) as executor:
        return attack(str(path), {}, options, folder=folder / "search", executor=executor)


def shrunk(table: dict[str, Any], searches: list[Attacked]) -> str:
    """Return the number of values of the first attack found, before and after shrinking."""
    for search in searches:
        for _, find, path in search.finds:
            if find.row.outcome == Outcome.VIOLATED:
                before, after = smallest(read_table(path), table).sizes
                return f"{before} → {after}"
    return "–"


def in_words(histories: Sequence[History]) -> str:
    """Return how many searches found a violated run, and the median number of runs to it."""
    most = max(len(history.finds) for history in histories)
    firsts = [float(h.violated[0].number) if h.violated else float("inf") for h in histories]
    successes = sum(first < float("inf") for first in firsts)
    median = statistics.median(firsts)
    middle = f"{median:g}" if median < float("inf") else f"more than {most}"
    return f"{successes} of {len(firsts)}, {middle}"


def main() -> None:
    """Print a row for each swarm, as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="?", default="", help="part of a swarm's name")
    parser.add_argument("--budget", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    print("| swarm | by CMA-ES: found, median runs | at random | values, shrunk |\n"
          "|---|---|---|---|", flush=True)  # fmt: skip
    with tempfile.TemporaryDirectory() as temporary:
        for number, (name, table) in enumerate(SWARMS.items()):
            if arguments.only not in name:
                continue
            folder = (arguments.out or Path(temporary)) / str(number)
            searches = [
                searched(
                    table(),
                    Options(arguments.budget, seed=seed, fresh=0, first=True),
                    folder / str(seed),
                )
                for seed in range(arguments.seeds)
            ]
            by_search, at_random = zip(*(each.histories for each in searches), strict=True)
            cells = in_words(by_search), in_words(at_random), shrunk(table(), searches)
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
