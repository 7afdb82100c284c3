"""Measure from when on a violation is inevitable, and how long before certificates are lost.

Random starts of the two pursuers of `guaranteed`, at least 3.3 m from each normal agent, until
enough runs are violated. Each is branched before its violation: all that is random is drawn again.
The picture shows, over the time before the violation, the share of runs that had lost their
certificate, and of those whose branches violated: half of them, and all.

    python evidence/attacks/inevitability.py --runs 50 --picture docs/images/inevitability.png
"""

import argparse
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

from matplotlib.figure import Figure

import phalanx
from phalanx.branches.inevitable import branch_run, from_when, landmarks
from phalanx.seeded.draws import Draws
from phalanx.swarm.swarm import build_swarm

AHEAD = (2.5, 2.0, 1.5, 1.0, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05, 0.02)
"""Times before the violation at which branches leave [s]."""
LASTS = 4.0
"""Duration of each run [s]."""
_NEVER = 0.0
"""Lead of what did not happen before the violation [s]."""
LOW, WIDTH = (-6.0, -10.0, -math.pi), (22.0, 20.0, 2.0 * math.pi)
"""Box of the starts (x, y, θ)."""


class Leads(NamedTuple):
    """Times before the violation [s]."""

    lost: float
    """From when on the pair had no certificate."""
    half: float
    """From when on half of the branches violate."""
    every: float
    """From when on all branches violate."""


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
    leads: list[Leads] = []
    for number, run in violated_runs(asked.scenario, asked.runs):
        moments = landmarks(run.summary)
        t = moments[0].t
        times = [t - ahead for ahead in AHEAD if t - ahead > 0.0]
        until = min(t + 0.6, LASTS)
        curve = branch_run(run.recording, times, asked.branches, until=until, at_once=asked.jobs)
        half, every = (from_when(curve, share) for share in (0.5, 1.0))
        lost = moments[1].t if len(moments) > 1 else None
        lead = Leads(*(_NEVER if each is None else t - each for each in (lost, half, every)))
        leads.append(lead)
        shown = " | ".join(_before(each, times[0] - t) for each in lead)
        print(f"| {number} | {moments[0].happens.split()[0]} | {t:.3f} s | {shown} |", flush=True)
    print(f"\nMedians of {len(leads)}: " + ", ".join(
        f"{what} {median(times):.2f} s before" for what, times in by_curve(leads).items()
    ) + ".")  # fmt: skip
    for what, sooner in (("half", [r.half > r.lost for r in leads]),
                         ("all", [r.every > r.lost for r in leads])):  # fmt: skip
        print(f"In {sum(sooner)} of {len(leads)} runs {what} of the branches violate from a time "
              "on at which the certificate was still there.")  # fmt: skip
    if asked.picture:
        draw(leads).savefig(asked.picture, dpi=110)


def by_curve(leads: list[Leads]) -> dict[str, list[float]]:
    """Return the leads of all runs, by what happened."""
    names = "certificate lost", "half of the branches violate", "all branches violate"
    return dict(zip(names, map(list, zip(*leads, strict=True)), strict=True))


def draw(leads: list[Leads]) -> Figure:
    """Draw the share of runs to which each had happened, over the time before the violation."""
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for what, times in by_curve(leads).items():
        grid = [*sorted(-lead for lead in times if lead > _NEVER), 0.0]
        shares = [sum(lead >= -t for lead in times if lead > _NEVER) / len(times) for t in grid]
        axes.step(grid, shares, where="post", label=what)
    axes.axvline(0.0, color="black", linewidth=1.0)
    axes.set_xlabel("time from the violation on [s]")
    axes.set_ylabel(f"share of {len(leads)} runs")
    axes.set_ylim(0.0, 1.05)
    axes.legend(frameon=False)
    return figure


def _before(lead: float, earliest: float) -> str:
    if lead == _NEVER:
        return "not before"
    return f"{1e3 * lead:.0f} ms{' or more' if lead >= -earliest - 1e-9 else ''} before"


if __name__ == "__main__":
    main()
