"""The price of a promise: filters and controllers with and without `keep`, over drawn starts.

    python -m evidence.promise.price [STARTS] [--duration SECONDS]

Four unicycles and a pursuer of `crossing` start anywhere in a square from where all pairs are
promised, and want to get to the other side, under adverse disturbances. *Safe* counts runs without
an unsafe pair; *of agents* those without one of two normal agents; *arrived* normal agents at their
goals at the end. *Effort* is the mean of ‖u - u_nom‖, *left* the share of steps in which the
fallback took the place of the wish.
"""

import argparse
from collections import defaultdict
from typing import Any

import numpy as np

from evidence.promise.starts import drawn_start
from phalanx.guarantee.promise import grades
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.recording.metrics.table import metrics_of
from phalanx.scenario.load import load
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import build_swarm

KEEP: dict[str, Any] = {"safety.keep": "hold"}
PAPER: dict[str, Any] = {
    "safety.composition": "lse",
    "safety.margin": "paper",
    "safety.information": "paper",
    "safety.eta": 1.0,
}
UNSTICK: dict[str, Any] = {
    "agents.0.law": {"type": "unstick", "of": {"type": "track-velocity", "gain": 0.5}}
}
FILTERS: dict[str, dict[str, Any]] = {
    "the paper's, η = 1": PAPER,
    "half rows": {},
    "half rows, `prove`": {"safety.prove": True},
    "`cbf-qp`": {"agents.0.controller": {"type": "cbf-qp"}},
    "`escape`": {"agents.0.controller": {"type": "escape"}},
    "none": {"agents.0.controller": {"type": "none"}},
    "half rows, `unstick`": UNSTICK,
    "none, `unstick`": UNSTICK | {"agents.0.controller": {"type": "none"}},
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("starts", type=int, nargs="?", default=200)
    parser.add_argument("--duration", type=float, default=20.0)
    chosen = parser.parse_args()
    starts = promised_starts(chosen.starts, {"duration": chosen.duration})
    heads = "filter", "`keep`", "safe", "of agents", "arrived", "effort", "left", "promises kept"
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name, changes in FILTERS.items():
        for keep in ({}, KEEP):
            print(
                f"| {name} | {'yes' if keep else 'no'} | {cells(starts, changes | keep)} |",
                flush=True,
            )


def promised_starts(count: int, changes: dict[str, Any]) -> list[dict[str, Any]]:
    """Draw starts from which all pairs are promised."""
    rng, starts = np.random.default_rng(0), list[dict[str, Any]]()
    while len(starts) < count:
        start = drawn_start("unicycles, hold", rng)
        start |= changes | {"agents.0.disturbance.kind": "adverse"}
        if not grades(build_swarm(load("crossing", start))).short:
            starts.append(start)
    return starts


def cells(starts: list[dict[str, Any]], changes: dict[str, Any]) -> str:
    """Run one case from all starts."""
    sums = defaultdict[str, float](float)
    for seed, start in enumerate(starts):
        overrides = start | {"safety.keep": None} | changes
        rows, records = shared_rows(load("crossing", overrides, seed)), RecordsInMemory()
        summary, swarm = Simulation(rows, records).run(), rows.swarm
        metrics = metrics_of(records.recording(swarm.scenario), swarm)
        agents = [metrics[swarm.names[i]] for i in swarm.normal]
        sums["safe"] += not summary.violations
        sums["of agents"] += all("rogue" in v.pair for v in summary.violations)
        sums["arrived"] += sum(bool(agent["arrived"]) for agent in agents)
        sums["effort"] += float(np.mean([agent["input_deviation_mean"] for agent in agents]))
        sums["left"] += summary.origins.get("fallback", 0) / summary.steps
        if promise := summary.promise:
            sums["promised"] += promise.promised
            sums["kept"] += promise.for_ever + promise.passively
    runs = len(starts)
    kept = f"{sums['kept']:.0f} of {sums['promised']:.0f}" if sums["promised"] else ""
    return (
        f"{sums['safe']:.0f} of {runs} | {sums['of agents']:.0f} | "
        f"{sums['arrived']:.0f} of {4 * runs} | {sums['effort'] / runs:.2f} | "
        f"{sums['left'] / runs:.1%} | {kept}"
    )


if __name__ == "__main__":
    main()
