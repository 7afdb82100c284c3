"""Search swarms that are known to be weak, and count the runs to the first violation.

python evidence/attacks/weak.py                   all swarms, 10 searches each, of 100 runs at most
python evidence/attacks/weak.py --budget 500      with another number of runs
python evidence/attacks/weak.py stale --seeds 3   one swarm, with three searches

Each search, by CMA-ES and at random, ends with the generation of its first violated run.
"""

import argparse
import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from phalanx.attacks.attack import Options, attack
from phalanx.attacks.search import History
from phalanx.scenario.load import read_table, scenario_text, set_field

AROUND = [[-2.0, 10.0], [-6.0, 6.0], [-3.14, 3.14]]
"""Starts of a unicycle around one at (4, 0)."""


def one_on_one(name: str, duration: float = 3.0, **fields: Any) -> dict[str, Any]:
    """Keep agents 1 and 4 of Simulation 1: one unicycle, and a pursuer 3 m away or more."""
    table = read_table(name)
    normal, pursuer = table["agents"]
    table["agents"] = [
        {**normal, "names": ["1"], "slots": [0]},
        {**pursuer, "names": ["4"], "slots": [2]},
    ]
    gain = {"agents.1.law.gain": {"log-uniform": [1.0, 25.0]}}
    table["attack"] = {"starts": {"4": AROUND}, "vary": gain, "apart": 3.0}
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
    """Take two agents that count on outdated inputs, at some distance and delay."""
    table = read_table("stale-inputs")
    table["attack"] = {
        "starts": {"2": [[1.0, 3.0], [-2.0, 2.0]]},
        "vary": {"network.delay": {"uniform": [0.0, 0.2]}},
        "certified": 2.0,
    }
    return {**table, "duration": 1.0}


SWARMS: dict[str, Callable[[], dict[str, Any]]] = {
    "no margin: unicycles, η = 0": lambda: one_on_one("unicycles", **{"safety.eta": 0.0}),
    "proven margin: guaranteed": lambda: one_on_one("guaranteed"),
    "half the margin: guaranteed": lambda: one_on_one("guaranteed", **{"safety.margin_scale": 0.5}),
    "lies: in-flight": lies,
    "a normal agent turns: split": turned,
    "stale inputs: paper": stale,
}
"""Swarms, each by a name."""


def searched(table: dict[str, Any], seed: int, budget: int) -> list[History]:
    """Return the histories of a search and of a random one."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        path = Path(folder) / "swarm.toml"
        path.write_text(scenario_text(table), encoding="utf-8")
        options = Options(budget, seed=seed, fresh=0, first=True)
        return attack(
            str(path), {}, options, folder=Path(folder) / "out", executor=executor
        ).histories


def in_words(histories: list[History]) -> str:
    """Return how many searches found a violated run, and the median number of runs to it."""
    most = max(len(history.finds) for history in histories)
    firsts = [float(h.violated[0].number) if h.violated else float("inf") for h in histories]
    found = sum(first < float("inf") for first in firsts)
    median = statistics.median(firsts)
    middle = f"{median:g}" if median < float("inf") else f"more than {most}"
    return f"{found} of {len(firsts)}, {middle}"


def main() -> None:
    """Print a row for each swarm, as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="?", default="", help="part of a swarm's name")
    parser.add_argument("--budget", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    print("| swarm | by CMA-ES: found, median runs | at random |\n|---|---|---|", flush=True)
    for name, table in SWARMS.items():
        if options.only in name:
            pairs = [searched(table(), seed, options.budget) for seed in range(options.seeds)]
            by_search, at_random = zip(*pairs, strict=True)
            print(f"| {name} | {in_words(list(by_search))} | {in_words(list(at_random))} |",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
