"""The disturbance gap for q > 1: the same run with the margin as printed, and corrected.

    python evidence/paper/disturbance_gap.py

ψ_1 is what the theorem says stays at or below 0 while every K_i is non-empty.
"""

import numpy as np

import phalanx
from phalanx.recording.read import Recording
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import EMPTY

_VARIANTS = {
    "paper, η = 5": ["safety.eta=5.0"],
    "paper, η = 0.5": [],
    "corrected, η = 0.5": ["safety.composition=pairs", "safety.margin=corrected"],
    "local": ["safety.composition=pairs", "safety.margin=local", "safety.eta=0"],
}


def main() -> None:
    """Run the variants of `disturbance-gap` and print a table."""
    print("| margin | max ψ_1 | max h | empty K_i | verdict |")
    print("|---|---|---|---|---|")
    for name, overrides in _VARIANTS.items():
        run = phalanx.run(phalanx.load("disturbance-gap", overrides), engine="in-process")
        assert run.summary is not None
        summary = run.summary
        empty = sum(summary.origins[origin] for origin in EMPTY)
        print(
            f"| {name} | {largest_psi_1(run.recording):.2f} | {summary.largest_h_tot:.2f} "
            f"| {empty} | {summary.outcome} |",
            flush=True,
        )


def largest_psi_1(recording: Recording) -> float:
    """The largest ψ_1 at any event of a run."""
    psi = build_rows(build_swarm(recording.scenario)).invariants()
    return float(np.max([psi(np.array(state.x))[1] for state in recording.states]))


if __name__ == "__main__":
    main()
