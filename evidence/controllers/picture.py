"""Draw h_tot over time under each controller of compare.py, in one run of each scenario.

python evidence/controllers/picture.py docs/images/controllers.png
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
from compare import CONTROLLERS, OURS, SCENARIOS, settings, simulated


def main() -> None:
    """Run each scenario once with each controller, and write the picture."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--only", choices=SCENARIOS, action="append", help="of the scenarios")
    arguments.add_argument("--seed", type=int, default=0)
    options = arguments.parse_args()
    names = options.only or list(SCENARIOS)
    figure, panels = plt.subplots(
        len(names), figsize=(8.0, 2.4 * len(names)), layout="constrained", squeeze=False
    )
    for name, axes in zip(names, panels[:, 0], strict=True):
        draw(axes, name, options.seed)
    panels[-1, 0].set_xlabel("t [s]")
    figure.savefig(options.picture, dpi=110)


def draw(axes: Any, name: str, seed: int) -> None:
    """Draw h_tot of a scenario under each controller that fits, and where it is first unsafe."""
    scale = 0.0
    for k, title in enumerate(CONTROLLERS):
        if (run := simulated(name, settings(name, title), seed)) is None:
            continue
        states, style = run.states, {"color": f"C{k}", "lw": 2.0 if title == OURS else 1.0}
        t, h = states["t"].to_numpy(), states["h_tot"].to_numpy()
        axes.plot(t, h, label=f"{title}: {run.verdict}", **style)
        if run.verdict == "violated":
            first = (h > 0.0).argmax()
            axes.plot(t[first], h[first], "x", color=f"C{k}", ms=8, mew=2)
        scale = max(scale, h.max())
    axes.axhspan(0.0, 1.1 * scale, color="#e00000", alpha=0.12, lw=0)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_title(f"{name}, seed {seed}", loc="left", fontsize=9)
    axes.set_ylabel("h_tot: safe is at most 0", fontsize=8)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))


if __name__ == "__main__":
    main()
