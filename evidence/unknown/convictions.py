"""False convictions of true motions, and convictions of lies by their size.

python evidence/unknown/convictions.py --windows 2000000
"""

import argparse

import numpy as np

from phalanx.swarm.swarm import DEFECT
from phalanx.theory.models.motion_check import MotionCheck
from tests.unit.theory.models.test_motion_check import DYNAMICS
from tests.unit.theory.models.windows import windows

BOUND, ERROR = 1.73, 0.003
"""φ^max, and the norm of a sensor's error."""
BATCH = 20_000
LIES = (0.1, 0.25, 0.5, 1.0, 1.9, 2.1, 3.0)
"""Sizes of a lie, ‖g δu‖ over φ^max."""


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--windows", type=int, default=200_000, help="for each dynamics")
    count = arguments.parse_args().windows
    print("| dynamics | windows | convicted | without a box | largest excess |")
    print("|---|---|---|---|---|")
    for name in DYNAMICS:
        excess = np.concatenate([true_motions(name, seed) for seed in range(count // BATCH)])
        unknown = int(np.isneginf(excess).sum())
        print(f"| {name} | {len(excess)} | {(excess > 0).sum()} | {unknown} | {excess.max():.2g} |")
    print("\n| lie over φ^max | convicted in one window of 10 ms |\n|---|---|")
    for size in LIES:
        print(f"| {size:g} | {100.0 * convicted(size):.1f} % |", flush=True)


def true_motions(name: str, seed: int) -> np.ndarray:
    """Return the excess of true motions, with disturbance and sensors at their bounds."""
    check = MotionCheck(DYNAMICS[name], BOUND + DEFECT, ERROR)
    return check.excess(*windows(DYNAMICS[name], BOUND, ERROR, BATCH, np.random.default_rng(seed)))


def convicted(size: float) -> float:
    """Return the share of windows that convict a single integrator, φ at random in its ball."""
    random, dynamics = np.random.default_rng(0), DYNAMICS["single integrator"]
    angle, other = random.uniform(0.0, 2.0 * np.pi, size=(2, BATCH))
    off = size * BOUND * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    phi = BOUND * np.sqrt(random.random(BATCH))[:, None]
    phi = phi * np.stack([np.cos(other), np.sin(other)], axis=1)
    x, seconds = np.zeros((BATCH, 2)), np.full((BATCH, 1), 0.01)
    excess = MotionCheck(dynamics, BOUND).excess(
        x, 0.01 * (off + phi), np.zeros((BATCH, 1, 2)), seconds
    )
    return float((excess > 0.0).mean())


if __name__ == "__main__":
    main()
