"""Promises kept over seeds: shipped scenarios, with their filter and with none, with and without.

    python -m evidence.promise.promises [SEEDS] [--duration SECONDS] [--only SCENARIO]

Each row is SEEDS runs in process. *Runs unsafe*: with a pair of normal agents or an obstacle; with
an adversary. *Left* is the share of steps in which the fallback took the
place of the wish; *arrived* that of normal agents that were at their goals at the end.
"""

import argparse
from collections import Counter
from typing import NamedTuple

import numpy as np

from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.recording.metrics.table import metrics_of
from phalanx.scenario.load import load
from phalanx.swarm.runnable import shared_rows

SCENARIOS = ("warehouse", "crossing", "swarm2d")
NONE: dict[str, object] = {"agents.0.controller": {"type": "none"}}
SEVERE: dict[str, object] = {"network.loss": 1.0}
KEEP: dict[str, object] = {"safety.keep": "hold"}
CASES: dict[str, dict[str, object]] = {
    "its filter": {},
    "its filter, `keep`": KEEP,
    "no filter": NONE,
    "no filter, `keep`, loss 1": NONE | KEEP | SEVERE,
}


class Row(NamedTuple):
    """The results of a case."""

    outcomes: Counter[str]
    promised: int
    """Pairs, over all seeds."""
    kept_pairs: int
    unsafe: Counter[str]
    """Runs with an unsafe pair without and with an adversary."""
    fallbacks: float
    arrived: list[bool]
    """By agents with a goal that comes to rest, and seeds."""

    def __str__(self) -> str:
        outcomes = ", ".join(f"{n} {name}" for name, n in sorted(self.outcomes.items()))
        promise = f"{self.kept_pairs} of {self.promised}" if self.promised else ""
        unsafe = f"{self.unsafe['normal']}, {self.unsafe['adversary']}"
        arrived = f"{sum(self.arrived)} of {len(self.arrived)}" if self.arrived else ""
        return f"{outcomes} | {unsafe} | {promise} | {self.fallbacks:.1%} | {arrived}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("seeds", type=int, nargs="?", default=5)
    parser.add_argument("--duration", type=float)
    parser.add_argument("--only", choices=SCENARIOS)
    chosen = parser.parse_args()
    heads = "scenario", "inputs", "verdicts", "runs unsafe", "promises kept", "left", "arrived"
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in (chosen.only,) if chosen.only else SCENARIOS:
        for case, changes in CASES.items():
            row = run_all(name, changes, chosen.seeds, chosen.duration)
            print(f"| `{name}` | {case} | {row} |", flush=True)


def run_all(name: str, changes: dict[str, object], seeds: int, duration: float | None) -> Row:
    """Run a scenario over seeds."""
    outcomes, unsafe, promised, kept_pairs = Counter[str](), Counter[str](), 0, 0
    shares, arrived = list[float](), list[bool]()
    for seed in range(seeds):
        shorter = {"duration": duration} if duration else {}
        rows = shared_rows(load(name, changes | shorter, seed))
        records = RecordsInMemory()
        summary = Simulation(rows, records).run()
        outcomes[str(summary.outcome)] += 1
        safe_set, normal = rows.swarm.safe_set, {*rows.swarm.normal}
        agents = [pair for pair in safe_set.pairs if pair[1] < len(safe_set.members)]
        attacked = {safe_set.label(pair) for pair in agents if not normal >= {*pair[:2]}}
        pairs = [v.pair in attacked for v in summary.violations]
        unsafe["adversary"] += any(pairs)
        unsafe["normal"] += not all(pairs)
        if summary.promise:
            promised += summary.promise.promised
            kept_pairs += summary.promise.for_ever + summary.promise.passively
        counts = summary.origins
        shares.append(counts.get("fallback", 0) / max(sum(counts.values()), 1))
        metrics = metrics_of(records.recording(rows.swarm.scenario), rows.swarm)
        ends = [metrics[rows.swarm.names[i]]["arrived"] for i in rows.swarm.normal]
        arrived += [bool(end) for end in ends if end is not None]
    return Row(outcomes, promised, kept_pairs, unsafe, float(np.mean(shares)), arrived)


if __name__ == "__main__":
    main()
