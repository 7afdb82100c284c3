"""Promises over drawn starts: robots close to one another, no filter, and all that a network loses.

    python -m evidence.promise.starts [RUNS] [--duration SECONDS] [--only CASE]

Each run draws all places in a square (and speeds) and keeps what is promised there. Robots want to
cross one another: in half of the runs with the scenario's filter, in the others with none. The
network fails in each way in turn, and every third run also turns a normal agent, if there are more.
*Conflicts* are runs in which the rule had to put a fallback in the place of a wish.
"""

import argparse
from collections import Counter
from typing import Any

import numpy as np

from phalanx.launcher.simulation import Simulation
from phalanx.scenario.load import load
from phalanx.swarm.runnable import shared_rows

NO_FILTER: dict[str, Any] = {"agents.0.controller": {"type": "none"}}
NETWORKS: tuple[dict[str, Any], ...] = (
    {"network.loss": 1.0},
    {"network.loss": {"mean": 0.5, "burst": 8.0}},
    {"network.delay": {"low": 0.0, "high": 0.5}},
    {"network.duplicate": 0.5, "network.delay": {"time": 0.1, "jitter": 0.1}},
    {"network.corrupt": 0.5},
    {"network.reorder": {"probability": 0.5, "gap": 2}, "network.delay": 0.2},
    {"network.slot": 0.2},
    {"network.loss_by_distance": {"none_within": 1.0, "all_beyond": 3.0}},
)
"""Of broadcasts."""
HOLD = {"safety.keep": "hold"}
POINTS: dict[str, Any] = {
    "agents.0.dynamics": {"type": "single-integrator", "speed": 2.5},
    "agents.1.dynamics": {"type": "unicycle", "speed": 0.8, "turn_rate": 2.0},
    "safety.keep": {"exit": [1.5, 0.0]},
}
DRAG = {"type": "double-integrator", "acceleration": 4.0, "drag": 0.5, "dimension": 2}
BRAKES: dict[str, Any] = {
    "agents.0.dynamics": DRAG,
    "agents.0.law": {"type": "track", "gains": [1.0, 2.0]},
    "agents.1.dynamics": DRAG | {"acceleration": 2.0},
    "agents.1.law": {"type": "chase", "gains": [1.0, 2.0]},
    "safety.alpha": [2.0, 2.0],
}
FLIGHT: dict[str, Any] = {
    "safety.keep": "flight",
    "safety.neighbourhood": None,
    "agents.0.names": ["east"],
    "agents.0.dynamics.speed": 4.0,
    "agents.1.dynamics.speed": 2.0,
    "agents.0.disturbance": {"bound": 0.2, "kind": "adverse"},
}
CASES: dict[str, tuple[dict[str, Any], float, float]] = {
    "unicycles, hold": (HOLD, 3.0, 0.0),
    "carts, hold": (
        HOLD | {"agents.0.dynamics": {"type": "differential-drive", "wheel_rate": 25.0,
                                      "wheel_radius": 0.1, "track": 0.5}}, 3.0, 0.0,
    ),
    "double integrators with drag, hold": (HOLD | BRAKES, 5.0, 1.5),
    "points, exit": (POINTS, 4.0, 0.0),
    "a unicycle and 2 pursuers, flight": (FLIGHT | {"agents.1.names": [*"ab"]}, 5.0, 0.0),
    "a unicycle and 4 pursuers, flight": (FLIGHT | {"agents.1.names": [*"abcd"]}, 5.0, 0.0),
}  # fmt: skip
"""By name: changes of `crossing`, half of the square's side [m], and largest speed [m/s]."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("runs", type=int, nargs="?", default=100)
    parser.add_argument("--duration", type=float, default=2.5)
    parser.add_argument("--only", choices=CASES)
    chosen = parser.parse_args()
    heads = "robots", "runs", "conflicts", "pairs promised", "unsafe of them", "runs broken"
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in (chosen.only,) if chosen.only else CASES:
        counts = run_all(name, chosen.runs, chosen.duration)
        numbers = (counts[head] for head in heads[1:])
        print(f"| {name} | {' | '.join(map(str, numbers))} |", flush=True)


def run_all(name: str, runs: int, duration: float) -> Counter[str]:
    """Run from drawn starts until so many runs had a promise."""
    counts, rng, seed = Counter[str](), np.random.default_rng(0), 0
    while counts["runs"] < runs:
        seed += 1
        overrides = drawn_start(name, rng) | {"duration": duration} | NETWORKS[seed % 8]
        if seed % 16 < 8:
            overrides |= NO_FILTER
        if seed % 3 == 0 and "agents.0.names" not in overrides:
            overrides["faults"] = [{"kind": "turn", "at": 0.5, "agents": ["east"]}]
        summary = Simulation(shared_rows(load("crossing", overrides, seed))).run()
        promise = summary.promise
        if promise is None or not promise.promised:
            continue
        counts["runs"] += 1
        counts["conflicts"] += summary.origins["fallback"] > 0
        counts["pairs promised"] += promise.promised
        counts["unsafe of them"] += sum("unsafe" in broken.why for broken in promise.broken)
        counts["runs broken"] += not promise.kept
        if promise.broken:
            print(f"<!-- seed {seed}: {promise} -->", flush=True)
    return counts


def drawn_start(name: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return a case's changes, with starts and goals of all, each goal on the other side."""
    changes, half, speed = CASES[name]
    normal = len(changes.get("agents.0.names", [*"news"]))
    count = normal + len(changes.get("agents.1.names", ["rogue"]))
    places = rng.uniform(-half, half, (count, 2))
    wheeled = np.column_stack([places, rng.uniform(-3.0, 3.0, count)]).tolist()
    moving = np.hstack([places, rng.uniform(-speed, speed, (count, 2))]).tolist()
    starts = {"unicycle": wheeled, "differential-drive": wheeled, "double-integrator": moving}
    kinds = [changes.get(f"agents.{g}.dynamics", {}).get("type", "unicycle") for g in (0, 1)]
    first, last = (starts.get(kind, places.tolist()) for kind in kinds)
    return changes | {
        "agents.0.start": first[:normal],
        "agents.0.goal": (-places[:normal]).tolist(),
        "agents.1.start": last[normal:],
    }


if __name__ == "__main__":
    main()
