"""Draw the share of runs with a hijack that ended safe, by what agents know of each other.

python evidence/unknown/hijacks_picture.py FOLDER docs/images/hijacks.png
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import polars as pl
from phalanx_studies.statistics import rate
from verdicts import CASES, INFORMATION, Case, cells, kept_rows

SHIFT = 0.12
"""Of a pair of points to the left and right, without and with proofs."""


def main() -> None:
    """Write the picture of all studies that the folder has."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("picture", type=Path)
    options = arguments.parse_args()
    cases = [case for case in CASES if (options.folder / case.scenario).exists()]
    figure, panels = plt.subplots(
        1, len(cases), figsize=(2.6 * len(cases), 3.0), layout="constrained", sharey=True
    )
    for case, axes in zip(cases, panels, strict=True):
        draw(axes, case, kept_rows(options.folder / case.scenario))
    panels[0].set_ylabel("share of runs safe")
    panels[-1].legend(fontsize=7, loc="lower right")
    figure.savefig(options.picture, dpi=110)


def draw(axes: Any, case: Case, rows: pl.DataFrame) -> None:
    """Draw the share of runs with a hijack at any instant, with 95 % intervals."""
    cells_of = cells(case, rows)
    for prove, shift, color, label in (
        (False, -SHIFT, "C0", "rows alone"),
        (True, SHIFT, "C1", "and proofs"),
    ):
        for column, information in enumerate(INFORMATION):
            runs = pl.concat(
                cell
                for (of, proves, attack), cell in cells_of.items()
                if (of, proves) == (information, prove) and attack.startswith("hijack")
            )
            if len(runs):
                safe = rate(runs["outcome"] != "violated", runs["seed"])
                at = column + shift
                axes.plot([at, at], safe.interval, color=color, lw=3, alpha=0.35)
                axes.plot(at, safe.share, "o", color=color, ms=4, label=label)
                label = "_again"
    axes.set_title(case.scenario, loc="left", fontsize=9)
    axes.set_xticks(range(len(INFORMATION)), INFORMATION, rotation=60, fontsize=8)
    axes.set_ylim(-0.03, 1.03)
    axes.grid(axis="y", alpha=0.3)


if __name__ == "__main__":
    main()
