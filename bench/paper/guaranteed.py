"""The proven scenario over many seeds, as shipped and with its proof taken away.

    python bench/paper/guaranteed.py [--seeds 20] [--only shipped]

`guaranteed` must be the verdict of every seed as shipped, and of none with half the margin or
twice the disturbance.
"""

import argparse
from collections import Counter

from seeds import infeasible, outcome, spread

from phalanx.guarantee.verdict import Summary

VARIANTS: dict[str, list[str]] = {
    "shipped": [],
    "half the margin": ["safety.margin_scale=0.5"],
    "twice the disturbance": [
        "agents.0.disturbance.bound=1.0",
        "agents.1.disturbance.bound=1.0",
    ],
}


def main() -> None:
    """Run every variant on every seed and print one line for each."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--only", choices=VARIANTS, action="append")
    options = arguments.parse_args()
    print(
        "| variant | verdicts | max h_tot, least to greatest | empty K_i: least, mean, greatest |"
    )
    print("|---|---|---|---|")
    for name in options.only or VARIANTS:
        runs = [outcome("guaranteed", VARIANTS[name], seed) for seed in range(options.seeds)]
        print(line(name, runs), flush=True)


def line(name: str, runs: list[Summary]) -> str:
    """One line of the table."""
    outcomes = Counter(str(run.outcome) for run in runs)
    verdicts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items()))
    worst = sorted(run.worst_h_tot for run in runs)
    return (
        f"| {name} | {verdicts} | {worst[0]:.2f} to {worst[-1]:.2f} | {spread(runs, infeasible)} |"
    )


if __name__ == "__main__":
    main()
