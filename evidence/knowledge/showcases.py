"""Run seven scenarios by radio, and with two baselines and the truth, over losses of broadcasts.

    python -m evidence.knowledge.showcases ROWS [SEEDS] [SCENARIO ...]

`ROWS` keeps a line of JSON for each run: what is there is not run again. The truth is the same
agents without a radio, who see all peers, so that its runs are the same at any loss. All
broadcasts take DELAY.
"""

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from phalanx_studies.statistics import clopper_pearson

import phalanx
from phalanx.scenario.model import Scenario

DELAY = 0.05
LOSSES = 0.0, 0.3, 0.7
SHOWCASES: Mapping[str, Mapping[str, Any]] = {
    "radio": {"duration": 20.0},
    "crossing-radio": {"duration": 14.0},
    "warehouse-radio": {"duration": 12.0},
    "guaranteed-radio": {"duration": 12.0},
    "formation3d-radio": {"duration": 40.0},
    "swarm2d": {
        "duration": 10.0,
        "agents.0.count": 12,
        "agents.0.radio": {"every": 5, "relays": 11},
    },
    "fence": {"agents.0.radio": {"every": 10, "relays": 2}},
}
"""Scenarios, and what is set of them; the last two ship without a radio."""
TRUTH = "truth"
KINDS: Mapping[str, Mapping[str, str] | None] = {
    "set, own parts": {},
    "carried on, halves": {"belief": "carried-on", "rows": "halves"},
    "newest, halves": {"belief": "newest", "rows": "halves"},
    TRUTH: None,
}
MEASURES = (
    "arrived",
    "arrival_time",
    "tracking_error_mean",
    "input_deviation_mean",
)
LAST = 0.5
"""An agent that stood so shortly before the end stands at the end [s]."""
Row = dict[str, Any]


class Rows:
    """Rows of runs, kept in a file."""

    def __init__(self, path: Path, measure: Callable[[Scenario], Row]) -> None:
        self._path, self._measure = path, measure
        lines = path.read_text("utf-8").splitlines() if path.exists() else []
        self._rows = {json.dumps(row["run"]): row for row in map(json.loads, lines)}

    def __call__(self, name: str, overrides: Mapping[str, Any], seed: int) -> Row:
        """Return the row of a run, which is made if it is not there."""
        key = {"scenario": name, "overrides": dict(overrides), "seed": seed}
        row = self._rows.get(json.dumps(key))
        if row is None:
            measures = self._measure(phalanx.load(name, overrides, seed=seed))
            row = self._rows[json.dumps(key)] = {"run": key, **measures}
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        return row


def measured(scenario: Scenario) -> Row:
    """Run a scenario, and return what that showed."""
    run = phalanx.run(scenario, engine="in-process")
    assert run.summary is not None
    deadlocks, until = run.summary.deadlocks or (), run.summary.t - LAST
    steps, swarm = run.recording.steps, run.metrics.row(-1, named=True)
    ages = [age for step in steps for _, age in step.ages]
    return {
        "outcome": run.summary.outcome,
        "worst": [run.summary.worst_pair, run.summary.worst_h],
        "failed": [a.name for a in run.summary.theorem if a.failed],
        "ages": np.percentile(ages, (50, 99)).tolist() if ages else None,
        "stand": [deadlock.agent for deadlock in deadlocks if deadlock.end > until],
        **{measure: swarm[measure] for measure in MEASURES},
    }


def cells() -> Iterator[tuple[str, str, float, Mapping[str, Any]]]:
    """Yield showcase, kind, loss and overrides of each cell."""
    for (name, settings), loss, (kind, belief) in product(SHOWCASES.items(), LOSSES, KINDS.items()):
        if kind == TRUTH and loss > 0.0:
            continue
        radio = None if belief is None else {**radio_of(name), **belief}
        network = {"network.loss": loss, "network.delay": DELAY}
        yield name, kind, loss, {**settings, "agents.0.radio": radio, **network}


@cache
def radio_of(name: str) -> Mapping[str, Any]:
    """Return the radio of a showcase."""
    radio = phalanx.load(name, SHOWCASES[name]).agents[0].radio
    assert radio is not None
    fields: Mapping[str, Any] = radio.model_dump(exclude_unset=True)
    return fields


def line(rows: Sequence[Row]) -> str:
    """Return the line of one cell."""
    outcomes = [row["outcome"] for row in rows]
    counts = [outcomes.count(outcome) for outcome in ("guaranteed", "safe", "violated")]
    low, high = clopper_pearson(counts[2], len(rows))
    arrived = [row["arrived"] for row in rows]
    times = [row["arrival_time"] for row in rows if row["arrival_time"] is not None]
    ages = [row["ages"] for row in rows if row["ages"]]
    old = " / ".join(f"{age:.2f}" for age in np.mean(ages, axis=0)) if ages else "–"
    return " | ".join(
        [
            *map(str, counts),
            f"{low:.2f} to {high:.2f}",
            f"{sum(arrived)} of {len(rows)}" if None not in arrived else "–",
            f"{np.mean(times):.1f}" if times else "–",
            f"{np.mean([row['tracking_error_mean'] for row in rows]):.2f}",
            f"{np.mean([row['input_deviation_mean'] for row in rows]):.2f}",
            old,
        ]
    )


def parse_options(seeds: int, scenarios: Iterable[str]) -> argparse.Namespace:
    """Read the file of rows, how many seeds, and which scenarios; the latter two by default."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("rows", type=Path)
    arguments.add_argument("seeds", type=int, nargs="?", default=seeds)
    arguments.add_argument("scenarios", nargs="*", default=list(scenarios))
    return arguments.parse_args()


def main() -> None:
    """Run seed after seed, and print the table."""
    chosen = parse_options(10, SHOWCASES)
    rows, table = Rows(chosen.rows, measured), dict[tuple[str, str, float], list[Row]]()
    wanted = [cell for cell in cells() if cell[0] in chosen.scenarios]
    for seed, (name, kind, loss, overrides) in product(range(chosen.seeds), wanted):
        table.setdefault((name, kind, loss), []).append(rows(name, overrides, seed))
    print(
        "| scenario | beliefs and rows | loss | guaranteed | safe | violated | rate, 95 % |"
        " all arrived | after, mean [s] | error [m] | effort | age, p50 / p99 [s] |"
    )
    print("|" + 12 * "---|")
    for (name, kind, loss), of_cell in table.items():
        print(f"| `{name}` | {kind} | {loss:g} | {line(of_cell)} |")


if __name__ == "__main__":
    main()
