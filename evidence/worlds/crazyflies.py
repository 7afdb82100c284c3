"""Fly scenario `worlds/crazyflies` over many seeds, and print verdicts and disturbances.

    pip install -e ./packages/phalanx-worlds
    python evidence/worlds/crazyflies.py --seeds 20 --picture docs/images/crazyflies.png

What is in build/worlds/crazyflies is not run again. Delete it after a change that moves
trajectories.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from declared import needed_by
from kept import arguments, cells, draw_disturbances, shares, studied

import phalanx

RADIUS, DECLARED = 0.4, 0.1
"""Those of the scenario [m], [m/s²]."""


def point(margin: str, bound: float) -> dict[str, Any]:
    """Return the fields in which variants differ."""
    bounds = {f"agents.{group}.disturbance.bound": bound for group in (0, 1)}
    return {"safety.margin": margin, "safety.eta": 0.0, **bounds}


VARIANTS = {
    "as shipped": point("integrated", DECLARED),
    "η = 0": point("paper", DECLARED),
    "φ declared half": point("integrated", DECLARED / 2),
}


def main() -> None:
    """Run what is missing; print the table, and what other declarations need."""
    options = arguments(__doc__)
    study, results = studied("worlds/crazyflies", VARIANTS, options)
    print(
        "| variant | runs | verdicts | φ declared | φ needed: 50 % | 99 % | largest "
        "| least distance [m] | worst h [m²] |\n|---|---|---|---|---|---|---|---|---|"
    )
    for title, variant in results.items():
        least, declared = variant.least_distance, VARIANTS[title]["agents.0.disturbance.bound"]
        ends = f"{least:.3f}", f"{RADIUS**2 - least**2:.4f}"
        runs = len(variant.runs)
        print(cells(title, runs, variant.verdicts, declared, *shares(variant.sizes), *ends))
    run = study.run(0, engine="in-process")
    print(
        "\n| declared, for the same inputs | φ needed: 50 % | 99 % | largest |\n|---|---|---|---|"
    )
    for title, sizes in needed_by(run).items():
        print(cells(title, *shares(sizes)))
    if options.picture:
        picture(run, options.picture)


def picture(run: phalanx.Run, path: Path) -> None:
    """Draw paths, and the disturbances that explain them with the declared bounds."""
    figure, (paths, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    run.plot("paths", axes={"paths": paths})
    draw_disturbances(run, right)
    right.axhline(DECLARED, color="black", linewidth=1.0, label="declared")
    right.axhline(DECLARED / 2, color="black", linewidth=1.0, linestyle=":", label="half")
    right.set(xlabel="t [s]", ylabel="‖φ̂‖ [m/s²]", ylim=(0.0, 1.1 * DECLARED))
    right.legend(fontsize="small", ncols=2)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
