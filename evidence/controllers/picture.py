"""Draw h_tot over time under each controller of compare.py, in one run with the same seed.

python evidence/controllers/picture.py docs/images/controllers.png --duration 16
"""

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
from compare import CONTROLLERS, SCENARIOS

import phalanx


def main() -> None:
    """Run the scenario once with each controller, and write the picture."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--scenario", choices=SCENARIOS, default="unicycles")
    arguments.add_argument("--duration", type=float, required=True, help="[s]")
    arguments.add_argument("--seed", type=int, default=0)
    options = arguments.parse_args()
    figure, axes = plt.subplots(figsize=(8.0, 3.2), layout="constrained")
    for title, overrides in CONTROLLERS.items():
        given = {**SCENARIOS[options.scenario], **overrides, "duration": options.duration}
        scenario = phalanx.load(options.scenario, given, seed=options.seed)
        run = phalanx.run(scenario, engine="in-process")
        states, width = run.states, 2.0 if not overrides else 1.0
        label = f"{title}: {run.verdict}"
        axes.plot(states["t"].to_numpy(), states["h_tot"].to_numpy(), lw=width, label=label)
    axes.axhspan(0.0, 1.2, color="#e00000", alpha=0.12, lw=0)
    axes.set(ylim=(-20.0, 1.2), xlabel="t [s]", ylabel="h_tot: safe is at most 0")
    figure.legend(fontsize=7, loc="outside right upper")
    figure.savefig(options.picture, dpi=110)


if __name__ == "__main__":
    main()
