"""Simulation 2 over many seeds: writes the table of docs/simulation-2.md.

python bench/paper/simulation_2.py             # seeds 0 to 19, 140 s each
python bench/paper/simulation_2.py --seeds 2 --out /dev/stdout
"""

import argparse
import statistics
from pathlib import Path

from rich.console import Console
from rich.progress import track
from simulation_1 import infeasible, outcome, spread, with_authority

from phalanx.guarantee.verdict import Outcome, Summary

SCENARIOS = {"formation3d": "β = 2/3", "formation3d-beta3": "β = 3"}


def main() -> None:
    """Run both drags over the seeds and write the page."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--out", type=Path, default=Path("docs/simulation-2.md"))
    options = arguments.parse_args()
    jobs = [(name, seed) for name in SCENARIOS for seed in range(options.seeds)]
    results: dict[str, list[Summary]] = {name: [] for name in SCENARIOS}
    for name, seed in track(jobs, "running", console=Console(stderr=True)):
        results[name].append(outcome(name, seed=seed))
    options.out.write_text(page(results))


def page(results: dict[str, list[Summary]]) -> str:
    """docs/simulation-2.md."""
    seeds = len(results["formation3d"])
    lines = [
        "# Simulation 2: eight double integrators in 3-D, four of them attacking",
        "",
        f"`scenarios/formation3d.toml` and `formation3d-beta3.toml`, seeds 0 to {seeds - 1}, 140 s "
        "each; every number on this page is printed by `python bench/paper/simulation_2.py`. "
        "Words and symbols are in the [glossary](glossary.md).",
        "",
        "![Simulation 2: paths, h_tot, and the inputs of a normal agent](images/formation3d.png)",
        "",
        "| drag | unsafe seeds | max h_tot, least to greatest | backup: least, mean, greatest "
        "| with authority | real-time factor |",
        "|---|---|---|---|---|---|",
    ]
    for name, runs in results.items():
        unsafe = sum(run.outcome is Outcome.VIOLATED for run in runs)
        worst = sorted(run.worst_h_tot for run in runs)
        factor = statistics.median(run.real_time_factor for run in runs)
        lines.append(
            f"| {SCENARIOS[name]} | {unsafe} of {len(runs)} | {worst[0]:.1f} to {worst[-1]:.1f} "
            f"| {spread(runs, infeasible)} | {spread(runs, with_authority)} | {factor:.1f} |"
        )
    lines += ["", "| seed | β = 2/3: max h_tot | backup | β = 3: max h_tot | backup |"]
    lines.append("|---|---|---|---|---|")
    for mild, strong in zip(*results.values(), strict=True):
        lines.append(
            f"| {mild.seed} | {mild.worst_h_tot:.1f} | {infeasible(mild):.1%} "
            f"| {strong.worst_h_tot:.1f} | {infeasible(strong):.1%} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
