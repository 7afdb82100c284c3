"""Tables of why robots of Simulation 2 are far from their goals, and what other gains give.

python evidence/paper/gains.py --jobs 2          # seeds 0 to 9
"""

import argparse
import multiprocessing
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from statistics import mean
from typing import Any, NamedTuple

import phalanx

PURSUERS = {"0": 2, "1": 0, "2": 1, "3": 1}
"""Adversaries whose target a normal agent is, in the scenario."""
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "α = 0.4, as shipped": {},
    "α = 1": {"safety.alpha": [1.0, 1.0]},
    "α = 2": {"safety.alpha": [2.0, 2.0]},
    "η = ξ = 0": {"safety.eta": 0.0, "safety.xi": 0.0},
    "k_1 = 0.5": {"agents.0.law.gains": [0.5, 2.0**0.5]},
    "one row for each pair, `split`": {
        "safety.composition": "pairs",
        "safety.information": "split",
    },
    "adversaries of 0.2 m/s² in place of 1.5": {"agents.1.dynamics.acceleration": 0.2},
}


class Outcome(NamedTuple):
    """A run: its verdict, and how far each normal agent was from its goal [m]."""

    verdict: str
    over_time: dict[str, float]
    at_end: dict[str, float]
    largest_h: float


def measure(job: tuple[str, int]) -> Outcome:
    variant, seed = job
    scenario = phalanx.load("formation3d", VARIANTS[variant], seed)
    run = phalanx.run(scenario, engine="in-process")
    rows = [row for row in run.metrics.to_dicts() if row["role"] == "normal"]
    over_time, at_end = (
        {row["agent"]: row[f"tracking_error_{when}"] for row in rows} for when in ("mean", "final")
    )
    assert run.summary is not None
    return Outcome(str(run.verdict), over_time, at_end, run.summary.worst_h)


def by_agent(outcomes: Sequence[Outcome]) -> None:
    print("| agent | pursuers | from its goal, mean [m] | at the end, least to greatest [m] |")
    print("|---|---|---|---|")
    for agent, pursuers in PURSUERS.items():
        ends = [outcome.at_end[agent] for outcome in outcomes]
        middle = mean(outcome.over_time[agent] for outcome in outcomes)
        print(f"| {agent} | {pursuers} | {middle:.1f} | {min(ends):.1f} to {max(ends):.1f} |")


def by_variant(outcomes: Mapping[str, Sequence[Outcome]]) -> None:
    print("| | verdicts | from their goals, mean [m] | at the end, by seed [m] | largest h |")
    print("|---|---|---|---|---|")
    for variant, runs in outcomes.items():
        verdicts = Counter(outcome.verdict for outcome in runs)
        words = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.most_common())
        middle = mean(mean(outcome.over_time.values()) for outcome in runs)
        ends = sorted(mean(outcome.at_end.values()) for outcome in runs)
        largest = max(outcome.largest_h for outcome in runs)
        print(
            f"| {variant} | {words} | {middle:.1f} "
            f"| {ends[0]:.1f} to {ends[-1]:.1f}, mean {mean(ends):.1f} | {largest:.1f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    jobs = list(product(VARIANTS, range(options.seeds)))
    # A fork would share the state of libraries that start threads.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=spawn) as pool:
        every = dict(zip(jobs, pool.map(measure, jobs), strict=True))
    outcomes = {v: [every[v, seed] for seed in range(options.seeds)] for v in VARIANTS}
    by_agent(outcomes["α = 0.4, as shipped"])
    print()
    by_variant(outcomes)


if __name__ == "__main__":
    main()
