"""Drive scenario `worlds/rovers` over many seeds, with and without failures; print verdicts and φ.

    pip install -e ./packages/phalanx-worlds
    python evidence/worlds/rovers.py --seeds 20 --picture docs/images/rovers.png

What is in build/worlds/rovers is not run again. Delete it after a change that moves trajectories.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from kept import arguments, cells, draw_disturbances, shares, studied

import phalanx

DECLARED, ROLLING = 0.25, 0.05
"""Those of the scenario."""


def point(
    duration: float, margin: str = "integrated", bound: float = DECLARED, **failed: Any
) -> dict[str, Any]:
    """Return the fields in which variants differ; a failure is agent 1's."""
    bounds = {f"agents.{group}.disturbance.bound": bound for group in (0, 1)}
    failures = [{"agent": "1", **failed}] if failed else []
    world = {"type": "mujoco", "rolling": ROLLING, "failures": failures}
    variant = {"safety.margin": margin, "safety.eta": 0.0, "world": world, "duration": duration}
    return variant | bounds


FAILED = "mass doubled at 0.5 s, accelerating"
VARIANTS = {
    "as shipped": point(24.0),
    "η = 0": point(24.0, margin="paper"),
    "φ declared half": point(6.0, bound=DECLARED / 2),
    FAILED: point(6.0, at=0.5, mass=2.0),
    "mass doubled at 2 s, at constant speed": point(6.0, at=2.0, mass=2.0),
    "left wheel stuck at 2 s": point(6.0, at=2.0, wheel="left"),
}


def main() -> None:
    """Run what is missing, and print the table."""
    options = arguments(__doc__)
    study, results = studied("worlds/rovers", VARIANTS, options)
    print(
        "| variant | runs | verdicts | disturbance bound failed | φ declared | φ needed: 50 % "
        "| 99 % | largest | least distance [m] | worst h_tot |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )
    for title, variant in results.items():
        failed = sum("disturbance bound" in reason for reason in variant.runs["reason"])
        declared, worst = (
            VARIANTS[title]["agents.0.disturbance.bound"],
            max(variant.runs["worst_h"]),
        )
        ends = f"{variant.least_distance:.3f}", f"{worst:.3f}"
        counts = len(variant.runs), variant.verdicts, failed
        print(cells(title, *counts, declared, *shares(variant.sizes), *ends))
    if options.picture:
        failing = list(VARIANTS).index(FAILED) * options.seeds
        runs = (study.run(number, engine="in-process") for number in (0, failing))
        picture(next(runs), next(runs), options.picture)


def picture(run: phalanx.Run, failing: phalanx.Run, path: Path) -> None:
    """Draw paths, and the disturbances that explain a run without and one with a failure."""
    figure, (paths, *axes) = plt.subplots(1, 3, figsize=(12.0, 3.6), layout="constrained")
    run.plot("paths", axes={"paths": paths})
    for case, title, panel in zip((run, failing), ("as shipped", FAILED), axes, strict=True):
        draw_disturbances(case, panel)
        panel.axhline(DECLARED, color="black", linewidth=1.0, label="declared")
        panel.set(xlabel="t [s]", ylabel="‖φ̂‖", title=title)
    axes[0].set(ylim=(0.0, 1.1 * DECLARED))
    axes[0].legend(fontsize="small", ncols=2)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
