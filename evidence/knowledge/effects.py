"""Measure the network effect by radio over loss, delay and period of broadcasts, in some scenarios.

    python -m evidence.knowledge.effects ROWS [SEEDS] [SCENARIO ...]

Partitions are left out. The last cell is the control: the same agents see all peers, over the worst
of these networks. `ROWS` keeps a line of JSON for each run: what is there is not run again.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from evidence.knowledge.showcases import SHOWCASES, Row, Rows, parse_options, radio_of
from phalanx.launcher.network_effect import network_effect
from phalanx.scenario.model import Scenario

DURATIONS = {
    "radio": 6.0,
    "crossing-radio": 8.0,
    "fence": 6.0,
    "guaranteed-radio": 4.0,
}
"""Of the runs of each scenario [s]."""
CELLS: Mapping[str, tuple[float, float, float]] = {
    "loss 0": (0.0, 0.05, 1.0),
    "loss .3": (0.3, 0.05, 1.0),
    "loss .7": (0.7, 0.05, 1.0),
    "delay 0": (0.3, 0.0, 1.0),
    "delay .2": (0.3, 0.2, 1.0),
    "period / 2": (0.3, 0.05, 0.5),
    "period x 2": (0.3, 0.05, 2.0),
}
"""Loss, delay [s], and the broadcast period as a multiple of the scenario's."""
CONTROL = "own sensors"
WORST = {"network.loss": 0.7, "network.delay": 0.2, "safety.silence": 100.0}
"""Of the control; a peer unheard for longer than `silence` counts in full."""
ABOVE = 0.01
"""Steps above this share of U count."""


def measured(scenario: Scenario) -> Row:
    """Return mean effect, and the share of steps above ABOVE."""
    effects = np.array([step.effect for step in network_effect(scenario)])
    return {"mean": float(effects.mean()), "above": float((effects > ABOVE).mean())}


def cells() -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield scenario, cell and overrides of each cell."""
    for name, (cell, (loss, delay, longer)) in product(DURATIONS, CELLS.items()):
        radio = radio_of(name)
        radio = {**radio, "every": max(1, int(longer * radio["every"]))}
        network = {"network.loss": loss, "network.delay": delay, "faults": []}
        yield name, cell, {**settings(name), "agents.0.radio": radio, **network}
    for name in DURATIONS:
        worst = {**WORST, "faults": []}
        yield name, CONTROL, {**settings(name), "agents.0.radio": None, **worst}


def settings(name: str) -> dict[str, Any]:
    """Return what is set of a scenario."""
    return {**SHOWCASES[name], "duration": DURATIONS[name]}


def span(values: Sequence[float]) -> str:
    """Return the mean, and the range over seeds, in percent."""
    low, mean, high = (100.0 * f(values) for f in (np.min, np.mean, np.max))
    spread = f" ({low:.1f} to {high:.1f})" if len(values) > 1 else ""
    return f"{mean:.1f}{spread}" if high else "0"


def main() -> None:
    """Run seed after seed, and print the table."""
    chosen = parse_options(5, DURATIONS)
    rows, table = Rows(chosen.rows, measured), dict[tuple[str, str], list[Row]]()
    wanted = [cell for cell in cells() if cell[0] in chosen.scenarios]
    for seed, (name, cell, overrides) in product(range(chosen.seeds), wanted):
        table.setdefault((name, cell), []).append(rows(name, overrides, seed))
    heads = [*CELLS, CONTROL]
    for key in ("mean", "above"):
        print(f"\n| {key} [%] | {' | '.join(heads)} | .3 over 0, least |")
        print("|" + (len(heads) + 2) * "---|")
        for name in chosen.scenarios:
            values = {cell: [row[key] for row in table[name, cell]] for cell in heads}
            pairs = zip(values["loss .3"], values["loss 0"], strict=True)
            least = min(lossy / clean if clean else np.inf for lossy, clean in pairs)
            spans = " | ".join(span(values[cell]) for cell in heads)
            print(f"| `{name}` | {spans} | {least:.2f} |")


if __name__ == "__main__":
    main()
