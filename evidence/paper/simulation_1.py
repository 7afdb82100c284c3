"""Simulation 1 over many seeds: writes docs/simulation-1.md.

python evidence/paper/simulation_1.py --jobs 2          # seeds 0 to 49
python evidence/paper/simulation_1.py --seeds 3 --only paper --out /dev/stdout
"""

from collections.abc import Iterable

from seeds import (
    CERTIFICATES,
    CERTIFICATES_NOTE,
    Results,
    Variant,
    certificates,
    command,
    covered,
    spread,
    with_authority,
    with_empty_set,
)

from phalanx.guarantee.verdict import Outcome, Summary

VARIANTS = {
    "paper": Variant("paper", "unicycles", ("safety.information=paper",)),
    "no-margin": Variant("paper, η = 0", "unicycles", ("safety.information=paper", "safety.eta=0")),
    "split": Variant("split", "unicycles", ("safety.information=split",)),
}


def page(results: Results) -> str:
    """docs/simulation-1.md."""
    return "\n".join(
        [
            "# Simulation 1: five unicycles, two of them pursuing",
            "",
            "`scenarios/unicycles.toml`, 24 s each; every number on this page is printed by "
            "`python evidence/paper/simulation_1.py`. Words and symbols are in the "
            "[glossary](glossary.md).",
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
            "*With authority*: those at which the backup could help; the others kept their "
            "nominal input (the agent stood far from every conflict). With `split`, K_i is empty "
            "only when all normal agents together could not satisfy the condition either.",
            "",
            *by_seed(results),
            "",
        ]
    )


def overview(results: Results) -> Iterable[str]:
    """One line for each variant."""
    yield "| information, margin | seeds | unsafe seeds | max h_tot, least to greatest | empty K_i: least, mean, greatest | with authority |"  # noqa: E501
    yield "|---|---|---|---|---|---|"
    for name, found in results.items():
        runs = [each.summary for each in found.values()]
        unsafe = sum(run.outcome is Outcome.VIOLATED for run in runs)
        worst = sorted(run.worst_h_tot for run in runs)
        yield (
            f"| {VARIANTS[name].title} | {covered(found)} | {unsafe} of {len(runs)} "
            f"| {worst[0]:.2f} to {worst[-1]:.2f} "
            f"| {spread(runs, with_empty_set)} | {spread(runs, with_authority)} |"
        )


def by_seed(results: Results) -> Iterable[str]:
    """One line for each seed."""
    head = "".join(
        f" {VARIANTS[name].title}: max h_tot | empty K_i | time unsafe [s] |" for name in results
    )
    yield f"| seed |{head}"
    yield "|---|" + 3 * len(results) * "---|"
    for seed in sorted({seed for found in results.values() for seed in found}):
        cells = [
            cell(found[seed].summary) if seed in found else " | | |" for found in results.values()
        ]
        yield f"| {seed} |" + "".join(cells)


def cell(run: Summary) -> str:
    """Three columns."""
    unsafe = sum(violation.duration for violation in run.violations)
    return f" {run.worst_h_tot:.2f} | {with_empty_set(run):.2%} | {unsafe:.3f} |"


if __name__ == "__main__":
    command("simulation-1", VARIANTS, page)
