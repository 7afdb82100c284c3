"""Measure from when on a violation is inevitable, and how long before certificates are lost.

Random starts of the two pursuers of `guaranteed`, at least 3.3 m from each normal agent, until
enough runs are violated. Each is branched before its violation: all that is random is drawn again.

    python evidence/attacks/inevitability.py --runs 50 --picture docs/images/inevitability.png
"""

import argparse
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from matplotlib.figure import Figure

import phalanx
from phalanx.branches.inevitable import BranchesAt, branch_run, from_when, landmarks
from phalanx.seeded.draws import Draws
from phalanx.swarm.swarm import build_swarm

AHEAD = (1.5, 1.0, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05, 0.02)
"""Times before the violation at which branches leave [s]."""
LASTS = 4.0
"""Duration of each run [s]."""
LOW, WIDTH = (-6.0, -10.0, -math.pi), (22.0, 20.0, 2.0 * math.pi)
"""Box of the starts (x, y, θ)."""


def violated_runs(scenario: str, count: int) -> Iterator[tuple[int, phalanx.Run]]:
    """Yield violated runs from random starts, with the number of the draw."""
    shipped, number, found = phalanx.load(scenario), -1, 0
    named = next(g for g in range(2) if shipped.agents[g].role == "adversary")
    swarm = build_swarm(shipped)
    normal = swarm.positions(swarm.start())[list(swarm.normal)]
    while found < count:
        number += 1
        draws = Draws(1, "inevitable", scenario, width=6)[number]
        starts = [
            [round(low + wide * float(u), 3) for low, wide, u in zip(LOW, WIDTH, part, strict=True)]
            for part in (draws[:3], draws[3:])
        ]
        if min(math.dist(start[:2], p) for start in starts for p in normal) < 3.3:
            continue
        fields = {
            f"agents.{named}.start": starts,
            f"agents.{named}.spread": [0.0, 0.0, 0.0],
            "duration": LASTS,
        }
        with tempfile.TemporaryDirectory() as folder:
            made = phalanx.run(phalanx.load(scenario, fields), engine="in-process", out=folder)
            if made.verdict is phalanx.Outcome.VIOLATED:
                found += 1
                yield number, made


def main() -> None:
    """Print a row for each violated run, medians, and draw three curves."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="guaranteed")
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--branches", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    print("| draw | pair | violated at | certificate lost | half inevitable | all inevitable |")
    print("|---|---|---|---|---|---|")
    leads: list[tuple[float, float | None, float | None]] = []
    curves: list[tuple[int, float, list[BranchesAt]]] = []
    for number, run in violated_runs(asked.scenario, asked.runs):
        moments = landmarks(run.summary)
        t = moments[0].t
        lost = t - moments[1].t if len(moments) > 1 else 0.0
        times = [t - ahead for ahead in AHEAD if t - ahead > 0.0]
        until = min(t + 0.6, LASTS)
        curve = branch_run(run.recording, times, asked.branches, until=until, at_once=asked.jobs)
        found = [from_when(curve, share) for share in (0.5, 1.0)]
        half, every = (None if each is None else t - each for each in found)
        leads.append((lost, half, every))
        curves.append((number, t, curve))
        pair = moments[0].happens.split()[0]
        print(f"| {number} | {pair} | {t:.3f} s | {1e3 * lost:.0f} ms before | "
              f"{_before(half)} | {_before(every)} |", flush=True)  # fmt: skip
    print(f"\nMedians of {len(leads)}: certificate lost {1e3 * median(l for l, _, _ in leads):.0f} "
          f"ms before; half of the branches violate from {_median([h for _, h, _ in leads])}, all "
          f"from {_median([e for _, _, e in leads])} before.")  # fmt: skip
    if asked.picture:
        draw(curves[:3]).savefig(asked.picture, dpi=110)


def draw(curves: list[tuple[int, float, list[BranchesAt]]]) -> Figure:
    """Draw the share of violated branches over the time before the violation."""
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for number, t, curve in curves:
        ahead = [each.t - t for each in curve]
        axes.plot(ahead, [each.share for each in curve], "o-", markersize=4, label=f"draw {number}")
    axes.axvline(0.0, color="black", linewidth=1.0)
    axes.set_xlabel("time at which branches leave, from the violation on [s]")
    axes.set_ylabel("share that violates")
    axes.legend(frameon=False)
    return figure


def _before(lead: float | None) -> str:
    more = " or more" if lead is not None and lead >= AHEAD[0] - 1e-9 else ""
    return "never" if lead is None else f"{lead:.2f} s{more} before"


def _median(leads: list[float | None]) -> str:
    """Median of lead times; a run that never gets there counts as 0."""
    return f"{median(lead or 0.0 for lead in leads):.2f} s"


if __name__ == "__main__":
    main()
