"""The proven scenarios over many seeds, and the first of them with its proof taken away.

    python evidence/paper/guaranteed.py [--seeds 20] [--only guaranteed]

*Theorem*: seeds on which all that the paper's theorem needs held too.
"""

import argparse
from collections import Counter

from seeds import Variant, outcome, spread, with_empty_set

from phalanx.guarantee.verdict import Summary

VARIANTS = {
    "guaranteed": Variant("`guaranteed`", "guaranteed"),
    "twice": Variant(
        "twice the disturbance",
        "guaranteed",
        ("agents.0.disturbance.bound=3.46", "agents.1.disturbance.bound=3.46"),
    ),
    "weak": Variant("α = 2", "guaranteed", ("safety.alpha=[2.0]",)),
    "heading-aware": Variant("`heading-aware`", "heading-aware"),
    "formation3d-distance": Variant("`formation3d-distance`", "formation3d-distance"),
}


def main() -> None:
    """Run every variant on every seed and print one line for each."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--only", choices=VARIANTS, action="append")
    options = arguments.parse_args()
    print(
        "| variant | verdicts | theorem | shortest certificate [τ] "
        "| max h_tot, least to greatest | empty K_i: least, mean, greatest |"
    )
    print("|---|---|---|---|---|---|")
    for name in options.only or VARIANTS:
        title, scenario, overrides = VARIANTS[name]
        runs = [outcome(scenario, overrides, seed) for seed in range(options.seeds)]
        print(line(title, runs), flush=True)


def line(title: str, runs: list[Summary]) -> str:
    """One line of the table."""
    outcomes = Counter(str(run.outcome) for run in runs)
    verdicts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items()))
    sufficient = sum(not any(a.failed for a in run.theorem) for run in runs)
    shortest = min(run.certificates.shortest or 0.0 for run in runs)
    worst = sorted(run.largest_h_tot for run in runs)
    return (
        f"| {title} | {verdicts} | {sufficient} of {len(runs)} | {shortest:.2f} "
        f"| {worst[0]:.2f} to {worst[-1]:.2f} | {spread(runs, with_empty_set)} |"
    )


if __name__ == "__main__":
    main()
