"""One row for each pair against one row for h_tot = LSE of all pairs, on both simulations.

    python evidence/paper/compositions.py [--seeds 20] [--out evidence/paper/compositions.md]

First the margin that can be proven, by the paper's formula over the workspace and locally at the
states of a run; then the outcomes of runs.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from variants import HEAD, measure, row, simulated

import phalanx
from phalanx.guarantee.formula import Formula
from phalanx.recording.read import Recording
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.margins.local import UNKNOWN

SIMULATIONS = {"Simulation 1": "unicycles", "Simulation 2": "formation3d"}
_PAIRS = ["safety.information=split", "safety.composition=pairs"]
VARIANTS = {
    "lse, `paper`": [],
    "pairs, `split`": _PAIRS,
    "pairs, `split`, η local": [*_PAIRS, "safety.margin=local", "safety.eta=0"],
}
"""Overrides by name; η is the paper's number unless said."""

NOTES = (
    "- *η by formula*: Eq. (mainetadef) or (etaprimedef), corrected, with constants over the "
    "workspace. For pairs it is that of the pair that needs most.",
    "- *η local*: the bound proven at each sample of the first normal agent in a run of seed 0. "
    "It is that of its closest pair.",
    "- *Cost*: mean ‖u - u_nom‖².",
)


def main() -> None:
    """Run everything and write the page."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20)
    arguments.add_argument("--only", choices=SIMULATIONS.values(), action="append")
    arguments.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    options = arguments.parse_args()
    chosen = options.only or list(SIMULATIONS.values())
    with options.out.open("w") as page:
        for line in lines(chosen, options.seeds):
            print(line, file=page, flush=True)


def lines(chosen: Sequence[str], seeds: int) -> Iterator[str]:
    """The page, as it comes."""
    yield "# One row for each pair, against one row for h_tot"
    yield ""
    yield (
        "This page compares one row for all pairs with one row for each pair: the margins that "
        f"can be proven, and runs of seeds 0 to {seeds - 1}. "
        "`python evidence/paper/compositions.py` writes it; terms are in the "
        "[glossary](../../docs/glossary.md)."
    )
    yield from ["", *NOTES]
    for title, name in SIMULATIONS.items():
        if name in chosen:
            yield from ["", f"## {title}: `{name}`", "", *margins(name), "", *HEAD]
            yield from (runs(name, variant, seeds) for variant in VARIANTS)


def runs(name: str, variant: str, seeds: int) -> str:
    """The row of one variant, over all seeds."""
    summaries = [
        measure(simulated(name, VARIANTS[variant], seed))
        for seed in track(range(seeds), f"{name}: {variant}", console=Console(stderr=True))
    ]
    return row(variant, summaries)


def margins(name: str) -> list[str]:
    """A table of what can be proven for one scenario."""
    report = phalanx.check(phalanx.load(name))
    assert report.formula is not None
    assert report.pair_formula is not None
    recording = simulated(name).recording
    local = _local(margins_of(recording))
    return [
        "| rows | η by formula over the workspace | η local: bounded at | median | p99 |",
        "|---|---|---|---|---|",
        f"| one for h_tot | {_formula(report.formula)} | - | - | - |",
        f"| one for each pair | {_formula(report.pair_formula)} | {local} |",
    ]


def margins_of(recording: Recording) -> Array:
    """The local margin of the closest pair at each sample of the first normal agent."""
    scenario = recording.scenario
    local = {"composition": "pairs", "margin": "local", "eta": 0.0}
    safety = scenario.safety.model_copy(update=local)
    rows = build_rows(build_swarm(scenario.model_copy(update={"safety": safety})))
    swarm = rows.swarm
    i = swarm.normal[0]
    states = {state.t: np.array(state.x) for state in recording.states}
    sampled = [states[step.t] for step in recording.steps if step.agent == swarm.names[i]]
    pair_terms = rows.pair_terms(i)
    terms_of = (pair_terms(x, swarm.seen(i, x)) for x in sampled)
    return np.array([terms.margin[terms.psi[:, 0].argmax()] for terms in terms_of])


def _formula(formula: Formula) -> str:
    how = "proven" if formula.proven else "at least: some constants are sampled"
    return f"{formula.corrected:.0f} ({how})"


def _local(margins: Array) -> str:
    bounded = margins[margins < UNKNOWN]
    if not len(bounded):
        return "no sample | - | -"
    median, high = np.percentile(bounded, [50, 99])
    return f"{len(bounded) / len(margins):.0%} of samples | {median:.3g} | {high:.3g}"


if __name__ == "__main__":
    main()
