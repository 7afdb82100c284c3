"""Convict by states that contradict each other: honest windows at their bounds, and lies in runs.

    python -m evidence.knowledge.lies [WINDOWS] [SEEDS]

Windows are of PARTS inputs, at random or at their bounds with one change per axis; φ, errors of
both states and of their times are at their bounds. Runs are of the scenario `radio`, in which agent
2 lies from 1 s on; each is of 2.5 s.
"""

import argparse
from dataclasses import replace

import numpy as np

import phalanx
from phalanx.knowledge.contradiction import unreached
from phalanx.knowledge.held import held, moved
from phalanx.theory.arrays import Array
from tests.unit.knowledge.adverse import draw_motion

PARTS, BATCH = 12, 10_000
PHI, PLACE, SPEED, STAMP = 0.1, 0.02, 0.05, 0.01
LIES: dict[str, dict[str, object]] = {
    "shift = [2, 0, 0, 0]": {"shift": [2.0, 0.0, 0.0, 0.0]},
    "drift = [0.5, 0, 0, 0]": {"drift": [0.5, 0.0, 0.0, 0.0]},
    "replay = 20": {"replay": 20},
}


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("windows", type=int, nargs="?", default=100_000)
    arguments.add_argument("seeds", type=int, nargs="?", default=20)
    chosen = arguments.parse_args()
    off = np.concatenate([honest(seed) for seed in range(chosen.windows // BATCH)])
    print("| honest windows | convicted | largest excess [m] |\n|---|---|---|")
    print(f"| {len(off)} | {(off > 0.0).sum()} | {off.max():.2g} |\n")
    print(
        "| lie | runs | convicted in | by, mean | first after, median | falsely |"
        " knowledge held | violated |\n|---|---|---|---|---|---|---|---|"
    )
    for name, lie in LIES.items():
        print(f"| `{name}` | {row(lie, chosen.seeds)} |", flush=True)


def honest(seed: int) -> Array:
    """Return the excess of true windows of one motion, shape (BATCH,)."""
    rng = np.random.default_rng(seed)
    drawn = draw_motion(rng)
    motion = replace(drawn, disturbance=PHI, position_error=PLACE, speed_error=SPEED)
    axes, size = motion.axes, (BATCH, motion.axes)
    time, before = rng.uniform(0.0, 2.0, BATCH), 3.0 * rng.normal(size=(BATCH, 2 * axes))
    signs, changes = rng.choice([-1.0, 1.0], size), rng.integers(0, PARTS + 1, size)
    pushed, x = on_sphere(PHI, BATCH, 2 * axes, rng), before
    factors = held(np.array(motion.drag), time[:, None] / PARTS)
    for part in range(PARTS):
        u = motion.acceleration * signs * np.where(part < changes, 1.0, -1.0)
        u = np.where(rng.random(size) < 0.5 * (seed % 2), rng.uniform(-1.0, 1.0, size) * u, u)
        x = moved(x, u + pushed[:, axes:], factors)
        x[:, :axes] += pushed[:, :axes] * time[:, None] / PARTS
    older, newer = (
        state + np.hstack([on_sphere(PLACE, BATCH, axes, rng), on_sphere(SPEED, BATCH, axes, rng)])
        for state in (before, x)
    )
    stamps = STAMP * rng.choice([-1.0, 1.0], (2, BATCH))
    return unreached(motion, older, newer, time + stamps[1] - stamps[0], 2.0 * STAMP)


def on_sphere(radius: float, count: int, axes: int, rng: np.random.Generator) -> Array:
    """Return vectors of this size, shape (count, axes)."""
    directions: Array = rng.normal(size=(count, axes))
    lengths: Array = np.linalg.norm(directions, axis=1, keepdims=True)
    return radius * directions / lengths


def row(lie: dict[str, object], seeds: int) -> str:
    """Run a lie with each seed, and return its row."""
    fault = {"kind": "lie", "agent": "2", "at": 1.0, "for": 99.0, **lie}
    first: list[float] = []
    found, by, falsely, held_in, violated = 0, 0, 0, 0, 0
    for seed in range(seeds):
        partition, *_ = phalanx.load("radio").model_dump(mode="json", by_alias=True)["faults"]
        partition = {key: value for key, value in partition.items() if value is not None}
        scenario = phalanx.load("radio", {"duration": 2.5, "faults": [partition, fault]}, seed=seed)
        summary = phalanx.run(scenario, engine="in-process").summary
        assert summary is not None
        assert summary.trust is not None
        after = [c.after for c in summary.trust.convictions if c.after is not None]
        found, by, first = found + bool(after), by + len(after), first + after[:1]
        falsely += summary.trust.false
        held_in += not any(a.name == "knowledge held" and a.failed for a in summary.theorem)
        violated += summary.outcome is phalanx.Outcome.VIOLATED
    median = f"{np.median(first):.2f} s" if first else "–"
    cells = seeds, found, f"{by / seeds:.1f} of 7", median, falsely, held_in, violated
    return " | ".join(map(str, cells))


if __name__ == "__main__":
    main()
