"""Promises of shipped scenarios: no filter, every failure of the network, and other attacks.

    python -m evidence.promise.shipped [RUNS] [--duration SECONDS] [--only SCENARIO]

Each scenario, or variant of one, keeps a fallback. Run k has seed k, no filter, the k-th way in
which a network fails, and in every other run adversaries that raise h fastest in place of its own,
with the worst disturbances of all. *Conflicts* are runs in which the rule had to put a fallback in
the place of a wish. It exits with 1 if a promise was broken.
"""

import argparse
import sys
from collections import Counter
from typing import Any

from evidence.promise.starts import HOLD, NETWORKS, NO_FILTER, POINTS
from phalanx.guarantee.promise import grades
from phalanx.launcher.simulation import Simulation
from phalanx.scenario.load import load
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import build_swarm

FREE: dict[str, Any] = {"safety.neighbourhood": None}
ONE: dict[str, Any] = {"agents.0.names": ["1"], "agents.0.slots": [0]}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    name: (name, HOLD)
    for name in ("crossing", "formation3d-distance", "one-on-one", "pinned", "prove",
                 "stale-inputs", "surrounded", "swarm2d", "unknown", "warehouse")
} | {
    "flight": ("flight", {}),
    "formation3d, all in sight": ("formation3d", HOLD | FREE),
    "crossing, points, exit": ("crossing", POINTS | {
        "agents.0.start": [[6.0, 0.0], [-6.0, 0.5], [0.5, 6.0], [0.0, -6.0]],
    }),
    "unicycles, φ = 0.4": ("unicycles", HOLD | {"agents.0.disturbance.bound": 0.4}),
    "unicycles, one, φ = 0.9, flight": ("unicycles", ONE | {"safety.keep": "flight"} | {
        f"agents.{g}.disturbance.bound": 0.9 for g in (0, 1)
    }),
}  # fmt: skip
"""By name: a scenario, and its changes."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("runs", type=int, nargs="?", default=16)
    parser.add_argument("--duration", type=float, default=3.0)
    parser.add_argument("--only", choices=CASES)
    chosen = parser.parse_args()
    heads = "scenario", "for ever", "passively", "not", "runs", "conflicts", "violated", "broken"
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    broken = 0
    for name in (chosen.only,) if chosen.only else CASES:
        graded = grades(build_swarm(load(CASES[name][0], CASES[name][1])))
        pairs = len(graded.for_ever), len(graded.passively), len(graded.short)
        counts = run_all(*CASES[name], chosen.runs, chosen.duration)
        broken += counts["broken"]
        cells = *pairs, chosen.runs, counts["conflicts"], counts["violated"], counts["broken"]
        print(f"| `{name}` | {' | '.join(map(str, cells))} |", flush=True)
    sys.exit(bool(broken))


def run_all(name: str, changes: dict[str, Any], runs: int, duration: float) -> Counter[str]:
    """Run a scenario so many times."""
    counts = Counter[str]()
    groups, worst = load(name, changes).agents, dict[str, Any]()
    for g, group in enumerate(groups):
        worst |= {f"agents.{g}.disturbance.kind": "adverse"} if group.disturbance.bound else {}
        # A truck with a goal keeps its way.
        hunts = group.role == "adversary" and group.goal is None
        worst |= {f"agents.{g}.law": {"type": "worst"}} if hunts else {}
    for seed in range(runs):
        overrides = changes | NO_FILTER | NETWORKS[seed % 8] | {"duration": duration}
        overrides |= worst if seed % 2 else {}
        summary = Simulation(shared_rows(load(name, overrides, seed))).run()
        counts["conflicts"] += summary.origins["fallback"] > 0
        counts["violated"] += bool(summary.violations)
        if summary.promise is None or not summary.promise.kept:
            counts["broken"] += 1
            print(f"<!-- seed {seed}: {summary.promise} -->", flush=True)
    return counts


if __name__ == "__main__":
    main()
