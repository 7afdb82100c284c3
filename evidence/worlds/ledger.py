"""Show what the ledger of disturbances finds of known ones, and how often its bound is kept.

    pip install -e ./packages/phalanx-worlds
    python evidence/worlds/ledger.py

The first table is of motions under a constant disturbance, with all shipped dynamics. The second
counts intervals of runs that keep the conformal bound of 199 others: drawn at random, those before
it, and all of a run with another seed.
"""

from collections.abc import Iterator

import numpy as np
from phalanx_worlds.fit_command import conformal_bound

import phalanx
from phalanx.network.draws import Draws
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import swarm_of
from phalanx.theory.arrays import Array
from tests.unit.guarantee.test_disturbance_ledger import MODELS, WINDOWS, explained, windows

SIZES = 1e-3, 0.03, 0.3
SCENARIOS = {"unicycles": 4.0, "worlds/rovers": 4.5}
"""Duration of each [s]."""
LEVELS = 0.9, 0.95, 0.99
BEFORE, COUNT = 199, 1000


def main() -> None:
    """Print both tables."""
    sizes = ", ".join(map(str, SIZES))
    print(f"Found / true, in {WINDOWS} motions each of ‖φ‖ = {sizes}:\n")
    print("| dynamics | least | largest |\n|---|---|---|")
    for dynamics in MODELS:
        ratios = np.array([explained(dynamics, windows(dynamics, s, 0.0)) / s for s in SIZES])
        print(f"| {type(dynamics).__name__} | {ratios.min():.7f} | {ratios.max():.7f} |")
    print(f"\nOf {COUNT} intervals, those within the bound of {BEFORE} others:\n")
    print("| run | level | at random | those before | another seed |\n|---|---|---|---|---|")
    for name, duration in SCENARIOS.items():
        here, there = (in_order(name, duration, seed) for seed in (0, 1))
        for level in LEVELS:
            counts = [sum(each) for each in zip(*covered(here, there, level), strict=True)]
            print(f"| {name} | {level} | {' | '.join(map(str, counts))} |")


def in_order(name: str, duration: float, seed: int) -> Array:
    """Return ‖φ̂‖ of the normal agents' intervals in the order of time."""
    scenario = phalanx.load(name, [f"duration={duration}"], seed=seed)
    run = phalanx.run(scenario, engine="in-process", out=None)
    swarm = swarm_of(run.recording)
    ledgers = disturbances_of(run.recording, swarm)
    t = np.concatenate([ledgers[i].t for i in swarm.normal])
    size: Array = np.concatenate([ledgers[i].size for i in swarm.normal])
    return size[np.argsort(t, kind="stable")]


def covered(here: Array, there: Array, level: float) -> Iterator[tuple[bool, bool, bool]]:
    """Yield whether each of COUNT intervals keeps the bounds of the three kinds of others."""
    elsewhere = conformal_bound(there, level)
    for k in range(COUNT):
        sample = here[np.argsort(Draws(0, "exchanged", width=len(here))[k])[: BEFORE + 1]]
        now = BEFORE + k
        yield (
            sample[-1] <= conformal_bound(sample[:-1], level),
            here[now] <= conformal_bound(here[k:now], level),
            here[now] <= elsewhere,
        )


if __name__ == "__main__":
    main()
