"""Bounds on the time until one agent is caught, and attacks that are tried, over starts.

    python -m evidence.promise.grid [STARTS] [--only KIND]

One agent that keeps a fallback and wants to pass a pursuer, at drawn places and speeds. T_lower is
what `phalanx check` promises: *for ever*, *until T* under this filter, or under any; T_attack when
the first of three attacks violates, each with adverse disturbances; T_upper its *impossible* time.
A start is *open* if it is neither promised for ever nor shown to be impossible. It exits with 1 if
T_lower > T_attack; attacks need not be the best, so that T_attack > T_upper is counted alone.
"""

import argparse
import math
import sys
from typing import Any, NamedTuple

import numpy as np

from phalanx.guarantee.impossible import impossible
from phalanx.guarantee.promise import grades
from phalanx.guarantee.start import promised
from phalanx.launcher.simulation import Simulation
from phalanx.scenario.load import load
from phalanx.swarm.runnable import shared_rows

DURATION = 12.0
BASE: dict[str, Any] = {
    "obstacles": [],
    "duration": DURATION,
    "agents.0.controller": {"type": "none"},
    "agents.0.clock": {"period": 0.02, "jitter": 0.004},
    "agents.1.count": 1,
    "agents.1.clock": {"period": 0.02, "jitter": 0.004},
}
DRAG = 0.5


class Kind(NamedTuple):
    """Robots of one kind."""

    overrides: dict[str, Any]
    speeds: tuple[float, float]
    """Least and largest bound on the pursuer's inputs."""
    dynamics: dict[str, Any]
    """The pursuer's, but for that bound."""
    bound: str
    """Its name."""
    laws: tuple[dict[str, Any], ...]
    """Attacks."""


WORST: dict[str, Any] = {"type": "worst"}
KINDS = {
    "points, exit": Kind(
        {
            "safety.keep": {"exit": [0.85, 0.0]},
            "agents.0.dynamics": {"type": "single-integrator", "speed": 1.0},
        },
        (0.4, 1.6),
        {"type": "single-integrator"},
        "speed",
        (WORST, {"type": "pursue", "gain": 2.0}, {"type": "pursue", "gain": 50.0}),
    ),
    "double integrators with drag, exit": Kind(
        {
            "safety.keep": {"exit": [1.7, 1.7]},
            "safety.alpha": [2.0, 2.0],
            "agents.0.dynamics": {"type": "double-integrator", "acceleration": 1.5, "drag": DRAG,
                                  "dimension": 2},
            "agents.0.law": {"type": "track", "gains": [1.0, 2.0]},
        },
        (0.4, 2.4),
        {"type": "double-integrator", "drag": DRAG, "dimension": 2},
        "acceleration",
        (
            WORST,
            {"type": "chase", "gains": [1.0, 2.0]},
            {"type": "chase", "gains": [50.0, 50.0 / DRAG]},
        ),
    ),
    "unicycles, flight": Kind(
        {"safety.keep": "flight"},
        (1.0, 6.0),
        {"type": "unicycle", "turn_rate": 2.0, "offset": 0.25},
        "speed",
        (WORST, {"type": "pursue", "gain": 2.0}, {"type": "pursue", "gain": 50.0}),
    ),
}  # fmt: skip


class Times(NamedTuple):
    """Times of one start [s]; infinite for never, or none."""

    lower: float
    attack: float
    upper: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("starts", type=int, nargs="?", default=300)
    parser.add_argument("--only", choices=KINDS)
    chosen = parser.parse_args()
    kinds = (chosen.only,) if chosen.only else tuple(KINDS)
    heads = ("robots", "starts", "for ever", "impossible", "open", "caught", "T_lower > T_attack",
             "T_attack > T_upper", "T_lower / T_attack", "T_attack / T_upper")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    wrong = 0
    for name in kinds:
        rng = np.random.default_rng(0)
        times = [times_of(KINDS[name], rng) for _ in range(chosen.starts // len(kinds))]
        wrong += sum(t.lower > t.attack for t in times)
        print(f"| {name} | {cells(times)} |", flush=True)
    sys.exit(bool(wrong))


def cells(times: list[Times]) -> str:
    """Return the cells of one kind; ratios are medians of those that are caught."""
    caught = [t for t in times if t.attack < math.inf]
    bounded = [t for t in caught if t.upper < math.inf]
    for_ever = sum(t.lower == math.inf for t in times)
    impossibles = sum(t.upper < math.inf for t in times)
    counts = (len(times), for_ever, impossibles, len(times) - for_ever - impossibles, len(caught),
              sum(t.lower > t.attack for t in times),
              sum(t.attack > t.upper for t in times if t.upper < DURATION))  # fmt: skip
    ratios = [t.lower / t.attack for t in caught], [t.attack / t.upper for t in bounded]
    medians = (f"{np.median(ratio):.2f}" if ratio else "" for ratio in ratios)
    return " | ".join([*map(str, counts), *medians])


def times_of(kind: Kind, rng: np.random.Generator) -> Times:
    """Draw a start that is safe, and return its times."""
    while True:
        angle, distance = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 5.0)
        place = distance * np.array([math.cos(angle), math.sin(angle)])
        bound, heading = rng.uniform(*kind.speeds), rng.uniform(-3.0, 3.0, 2)
        more = {"unicycle": heading[:, None], "double-integrator": np.zeros((2, 2))}
        extra = more.get(kind.dynamics["type"], np.zeros((2, 0)))
        overrides = BASE | kind.overrides | {
            "agents.0.start": [[0.0, 0.0, *extra[0].tolist()]],
            "agents.0.goal": [(2.0 * place).tolist()],
            "agents.0.disturbance": {"bound": 0.05, "kind": "adverse", "every": 0.1},
            "agents.1.disturbance": {"bound": 0.05, "kind": "adverse", "every": 0.1},
            "agents.1.dynamics": kind.dynamics | {kind.bound: bound},
            "agents.1.start": [[*place.tolist(), *extra[1].tolist()]],
        }  # fmt: skip
        swarm = shared_rows(load("flight", overrides | {"agents.1.law": WORST})).swarm
        graded, ahead = grades(swarm), promised(swarm)
        if ahead.time > 0.0:
            break
    lower = math.inf
    if not graded.for_ever:
        lower = max(*graded.until.values(), ahead.time) if graded.until else ahead.time
    upper = min(impossible(swarm).times.values(), default=math.inf)
    attack = math.inf
    for law in kind.laws:
        rows = shared_rows(load("flight", overrides | {"agents.1.law": law}))
        violations = Simulation(rows).run().violations
        attack = min([attack, *(v.first for v in violations)])
    return Times(lower, attack, upper)


if __name__ == "__main__":
    main()
