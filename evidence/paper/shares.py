"""Shares of one h_tot: what they cost, and whether they add up while they are held.

    python evidence/paper/shares.py --seeds 20
    python evidence/paper/shares.py --only formation3d --seeds 2

Compares `split` with `paper` on the paper's simulations, and with shares that keep no reserve for
the different samples they are computed from. Cost is as in variants.py; its ratio to `paper` is the
mean over seeds. J is the joint sum with the inputs in force, at every recorded instant at which all
rows held: as inputs take effect, and just before the next ones do.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.progress import track
from stale_input import ROUNDING, joint_sums
from variants import Measured, measure, simulated

import phalanx
from phalanx.recording.read import Recording
from phalanx.theory.rows.share_margin import ShareMargin

_SPLIT = ["safety.information=split"]


class Sums(NamedTuple):
    """J of one run."""

    certified: int
    """While every row held."""
    false: int
    """Of these, those above 0."""
    short: int
    """Of these, those above η."""
    worst: float


def main() -> None:
    """Run every seed and print a table for each scenario."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20)
    arguments.add_argument("--only", default="unicycles,formation3d")
    options = arguments.parse_args()
    for name in options.only.split(","):
        print(f"\n{name}, η = {phalanx.load(name).safety.eta}, {options.seeds} seeds\n")
        print("| rule | unsafe | empty K_i | cost / `paper` | J > 0 | J > η | max J |")
        print("|---|---|---|---|---|---|---|")
        seeds = track(range(options.seeds), name, console=Console(stderr=True))
        runs = [_compared(name, seed) for seed in seeds]
        of_paper, alone, shared = zip(*runs, strict=True)
        print(_row("`paper`", of_paper, of_paper))
        print(_row("shares alone", alone, of_paper))
        print(_row("`split`", shared, of_paper), flush=True)


_Judged = tuple[Measured, Sums | None]


def _compared(name: str, seed: int) -> tuple[_Judged, _Judged, _Judged]:
    of_paper = measure(simulated(name, [], seed)), None
    shared = _judged(simulated(name, _SPLIT, seed))
    with patch.object(ShareMargin, "__call__", lambda *_: 0.0):
        alone = _judged(simulated(name, _SPLIT, seed))
    return of_paper, alone, shared


def _judged(run: phalanx.Run) -> _Judged:
    return measure(run), sums(run.recording)


def sums(recording: Recording) -> Sums:
    """J of a run whose agents keep shares."""
    certified = [now for now in joint_sums(recording) if all(now.held.values())]
    return Sums(
        certified=len(certified),
        false=sum(now.joint > ROUNDING for now in certified),
        short=sum(now.joint > now.eta + ROUNDING for now in certified),
        worst=max(now.joint for now in certified),
    )


def _row(title: str, runs: Sequence[_Judged], of_paper: Sequence[_Judged]) -> str:
    unsafe = sum(run.outcome == "violated" for run, _ in runs)
    empty = np.mean([run.backup for run, _ in runs])
    ratios = [a.cost / b.cost for (a, _), (b, _) in zip(runs, of_paper, strict=True)]
    cost = f"{np.mean(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
    found = [each for _, each in runs if each is not None]
    found = [each for _, each in runs if each is not None]
    if not found:
        return f"| {title} | {unsafe} | {empty:.1%} | {cost} | | | |"
    certified = sum(each.certified for each in found)
    false, short = sum(each.false for each in found), sum(each.short for each in found)
    worst = max(each.worst for each in found)
    judged = f"{false} of {certified} | {short} of {certified} | {worst:.2f}"
    return f"| {title} | {unsafe} | {empty:.1%} | {cost} | {judged} |"


if __name__ == "__main__":
    main()
