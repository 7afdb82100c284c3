"""Information models, and the one controller, side by side: verdicts, backups, cost, solve time.

    python evidence/paper/variants.py unicycles --seeds 5 [--only centralised]

Cost is the mean of ‖u - u_nom‖² over the normal agents' steps, in the QP's metric. Solve time is
an agent's whole step, without the wire; of a centralised controller, all its steps of an instant.
Runs are of the in-process engine, whose trajectories are those of the processes to the last bit.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

import phalanx
from phalanx.recording.read import Recording
from phalanx.scenario.model import Scenario
from phalanx.schema.fields import CONTROLLER
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.rows.origin import EMPTY

VARIANTS = {
    "paper": [],
    "centralised": ["safety.control=centralised"],
    "in-flight": ["safety.information=in-flight"],
    "split": ["safety.composition=pairs", "safety.information=split"],
    "worst-case": ["safety.information=worst-case"],
}
"""Overrides by name. All run with synchronous clocks if --synchronous is given."""


HEAD = (
    "| variant | verdicts | max h_tot | empty K_i | cost |",
    "|---|---|---|---|---|",
)
"""Of the table that row() makes lines of."""


class Measured(NamedTuple):
    """One run."""

    outcome: str
    worst_h: float
    backup: float
    """Share of steps whose K_i was empty."""
    cost: float
    solve: float
    """Median [s]."""
    slowest: float
    """Its 99th percentile [s]."""


def main() -> None:
    """Run every variant on every seed and print a table of means."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenario")
    arguments.add_argument("--seeds", type=int, default=5)
    arguments.add_argument("--only", choices=VARIANTS, action="append")
    arguments.add_argument("--synchronous", action="store_true", help="clocks without jitter")
    arguments.add_argument("--set", action="append", default=[], dest="overrides")
    options = arguments.parse_args()
    common = [
        *options.overrides,
        *_synchronous(phalanx.load(options.scenario), options.synchronous),
    ]
    print(f"{HEAD[0]} p50, p99 [µs] |\n{HEAD[1]}---|")
    for name in options.only or VARIANTS:
        overrides = [*common, *VARIANTS[name]]
        seeds = track(range(options.seeds), name, console=Console(stderr=True))
        runs = [measure(simulated(options.scenario, overrides, seed)) for seed in seeds]
        print(row(name, runs), times(runs), flush=True)


def row(name: str, runs: Sequence[Measured]) -> str:
    """One line of the table."""
    outcomes = [r.outcome for r in runs]
    counts = ", ".join(f"{outcomes.count(o)} {o}" for o in sorted(set(outcomes)))
    highest = [r.worst_h for r in runs]
    backup, cost = np.mean([(r.backup, r.cost) for r in runs], axis=0).tolist()
    span = f"{min(highest):.2f} to {max(highest):.2f}"
    return f"| {name} | {counts} | {span} | {backup:.1%} | {cost:.2f} |"


def times(runs: Sequence[Measured]) -> str:
    """The last column: means of the runs' medians and 99th percentiles."""
    solve, slowest = np.mean([(r.solve, r.slowest) for r in runs], axis=0).tolist()
    return f"{solve * 1e6:.0f}, {slowest * 1e6:.0f} |"


def simulated(name: str, overrides: Sequence[str] = (), seed: int | None = None) -> phalanx.Run:
    """A finished run of a scenario."""
    return phalanx.run(phalanx.load(name, overrides, seed), engine="in-process")


def measure(run: phalanx.Run) -> Measured:
    """Measure a run."""
    recording, summary = run.recording, run.summary
    assert summary is not None
    swarm = build_swarm(recording.scenario)
    steps = sum(summary.origins.values())
    normal = {swarm.names[i] for i in swarm.normal}
    centralised = recording.scenario.safety.centralised
    times: dict[tuple[float, str], float] = defaultdict(float)
    for step in recording.steps:
        if step.agent in normal:
            times[step.t, CONTROLLER if centralised else step.agent] += step.solve_time
    solve, slowest = np.percentile(list(times.values()), [50, 99]).tolist()
    backup = sum(summary.origins[o] for o in EMPTY) / steps
    worst, price = summary.largest_h_tot, cost(recording, swarm)
    return Measured(summary.outcome, worst, backup, price, solve, slowest)


def cost(recording: Recording, swarm: Swarm) -> float:
    """Mean ‖u - u_nom‖² of the normal agents, in the QP's metric."""
    weights = {
        swarm.names[i]: np.array(swarm.members[i].dynamics.input_metric()) for i in swarm.normal
    }
    costs = [
        weights[step.agent] @ (np.array(step.u) - np.array(step.u_nom)) ** 2
        for step in recording.steps
        if step.agent in weights
    ]
    return float(np.mean(costs))


def _synchronous(scenario: Scenario, synchronous: bool) -> list[str]:
    if not synchronous:
        return []
    return [f"agents.{g}.clock.jitter=0.0" for g in range(len(scenario.agents))]


if __name__ == "__main__":
    main()
