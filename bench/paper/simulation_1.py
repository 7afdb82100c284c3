"""Simulation 1 over many seeds: writes the table of docs/simulation-1.md.

python bench/paper/simulation_1.py             # seeds 0 to 19, about ten minutes on two cores
python bench/paper/simulation_1.py --seeds 3 --out /dev/stdout
"""

import argparse
import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

import phalanx
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.theory.rows.origin import EMPTY, Origin

VARIANTS = {
    "paper": ["safety.information=paper"],
    "paper, η = 0": ["safety.information=paper", "safety.eta=0"],
    "split": ["safety.information=split"],
}


def main() -> None:
    """Run every variant over the seeds and write the page."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--out", type=Path, default=Path("docs/simulation-1.md"))
    options = arguments.parse_args()
    jobs = [(name, seed) for seed in range(options.seeds) for name in VARIANTS]
    results: dict[str, list[Summary]] = {name: [] for name in VARIANTS}
    for name, seed in track(jobs, "running", console=Console(stderr=True)):
        results[name].append(outcome("unicycles", VARIANTS[name], seed))
    options.out.write_text(page(results))


def outcome(name: str, overrides: Sequence[str] = (), seed: int | None = None) -> Summary:
    """What a run of a shipped scenario came to."""
    run = phalanx.run(phalanx.load(name, overrides, seed), engine="in-process")
    assert run.summary is not None
    return run.summary


def page(results: dict[str, list[Summary]]) -> str:
    """docs/simulation-1.md."""
    seeds = len(results["paper"])
    return "\n".join(
        [
            "# Simulation 1: five unicycles, two of them pursuing",
            "",
            f"`scenarios/unicycles.toml`, seeds 0 to {seeds - 1}, 24 s each; every number on this "
            "page is printed by `python bench/paper/simulation_1.py`. Words and symbols are in the "
            "[glossary](glossary.md).",
            "",
            *overview(results),
            "",
            "*Infeasible*: updates of normal agents for which no input satisfied the row (empty "
            "K_i). *With authority*: those at which the backup could help; the others kept their "
            "nominal input (the agent stood far from every conflict). With `split`, a row is "
            "infeasible only when all normal agents together could not satisfy it either.",
            "",
            *by_seed(results),
            "",
        ]
    )


def overview(results: dict[str, list[Summary]]) -> Iterable[str]:
    """One line for each variant."""
    yield "| information, margin | unsafe seeds | max h_tot, least to greatest | infeasible: least, mean, greatest | with authority | real-time factor |"  # noqa: E501
    yield "|---|---|---|---|---|---|"
    for name, runs in results.items():
        unsafe = sum(run.outcome is Outcome.VIOLATED for run in runs)
        worst = sorted(run.worst_h_tot for run in runs)
        factor = statistics.median(run.real_time_factor for run in runs)
        yield (
            f"| {name} | {unsafe} of {len(runs)} | {worst[0]:.2f} to {worst[-1]:.2f} "
            f"| {spread(runs, infeasible)} | {spread(runs, with_authority)} | {factor:.1f} |"
        )


def by_seed(results: dict[str, list[Summary]]) -> Iterable[str]:
    """One line for each seed."""
    yield "| seed | paper: max h_tot | infeasible | η = 0: max h_tot | time unsafe [s] | split: max h_tot | infeasible |"  # noqa: E501
    yield "|---|---|---|---|---|---|---|"
    for paper, bare, split in zip(*results.values(), strict=True):
        unsafe = sum(violation.duration for violation in bare.violations)
        yield (
            f"| {paper.seed} | {paper.worst_h_tot:.2f} | {infeasible(paper):.1%} "
            f"| {bare.worst_h_tot:.2f} | {unsafe:.3f} "
            f"| {split.worst_h_tot:.2f} | {infeasible(split):.2%} |"
        )


def infeasible(run: Summary) -> float:
    """Share of normal agents' updates whose QP had no solution."""
    return sum(run.origins[o] for o in EMPTY) / sum(run.origins.values())


def with_authority(run: Summary) -> float:
    """Share of normal agents' updates on the backup LP."""
    return run.origins[Origin.BACKUP] / sum(run.origins.values())


def spread(runs: list[Summary], share: Callable[[Summary], float]) -> str:
    """Least, mean and greatest of a share over the runs."""
    shares = [share(run) for run in runs]
    return f"{min(shares):.1%}, {statistics.mean(shares):.1%}, {max(shares):.1%}"


if __name__ == "__main__":
    main()
