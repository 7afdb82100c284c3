"""Simulation 1 over many seeds: writes docs/simulation-1.md.

python evidence/paper/simulation_1.py --jobs 2          # seeds 0 to 49
python evidence/paper/simulation_1.py --seeds 3 --only paper --out /dev/stdout
"""

import statistics
from collections.abc import Iterable

from flagship import section
from seeds import (
    CERTIFICATES,
    CERTIFICATES_NOTE,
    Results,
    Variant,
    certificates,
    command,
    spread,
    with_authority,
    with_empty_set,
)

VARIANTS = {
    "paper": Variant("paper", "unicycles", ("safety.information=paper",)),
    "no-margin": Variant("paper, η = 0", "unicycles", ("safety.information=paper", "safety.eta=0")),
}


def page(results: Results) -> str:
    """docs/simulation-1.md."""
    return "\n".join(
        [
            "# Simulation 1: five unicycles, two of them pursuing",
            "",
            "Verdicts of the paper's first simulation over many seeds, with and without its "
            "margin. `scenarios/unicycles.toml` runs for 24 s each; "
            "`python evidence/paper/simulation_1.py` writes this page.",
            "",
            "## Verdicts and certificates",
            "",
            *CERTIFICATES,
            *(certificates(VARIANTS[name].title, found) for name, found in results.items()),
            "",
            CERTIFICATES_NOTE,
            "",
            "## Safety and empty K_i",
            "",
            *overview(results),
            "",
            "*Empty K_i*: control steps of normal agents for which no input satisfied the row. "
            "*With authority*: steps at which the backup could help; at the others the agent was "
            "far from every conflict and kept its nominal input.",
            "",
            *section("simulation-1"),
        ]
    )


def overview(results: Results) -> Iterable[str]:
    """One line for each variant."""
    yield "| variant | max h_tot, least to greatest | empty K_i: least, mean, greatest | with authority | time unsafe [s]: least, mean, greatest |"  # noqa: E501
    yield "|---|---|---|---|---|"
    for name, by_seed in results.items():
        runs = [each.summary for each in by_seed.values()]
        worst = sorted(run.largest_h_tot for run in runs)
        times = [sum(violation.duration for violation in run.violations) for run in runs]
        yield (
            f"| {VARIANTS[name].title} | {worst[0]:.2f} to {worst[-1]:.2f} "
            f"| {spread(runs, with_empty_set)} | {spread(runs, with_authority)} "
            f"| {min(times):.1f}, {statistics.mean(times):.1f}, {max(times):.1f} |"
        )


if __name__ == "__main__":
    command("simulation-1", VARIANTS, page)
