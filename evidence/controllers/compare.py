"""Compare controllers on the same scenarios, seeds, network and nominal law.

    pip install pyrvo cbfpy
    python evidence/controllers/compare.py --seeds 20

Every result is a file under build/controllers, written as soon as it is there; what is there is not
run again. Delete the folder after a change that moves trajectories. The tables go to the terminal.
"""

import argparse
import itertools
import statistics
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import phalanx
from phalanx.guarantee.verdict import Outcome

KEPT = Path("build/controllers")
OURS = "the paper's filter"
_OF_LIBRARIES = ("examples.controllers.cbfpy_barriers:CbfPy", "examples.controllers.orca:Orca")
CONTROLLERS: dict[str, dict[str, Any]] = {OURS: {}} | {
    name.partition(":")[2] or name: {"agents.0.controller.type": name}
    for name in ("shield:Shield", "cbf-qp", "clf-cbf", *_OF_LIBRARIES, "escape", "none")
}
BAD = {"network.loss": 0.2, "network.delay": {"low": 0.0, "high": 0.05}}
SCENARIOS: dict[str, dict[str, Any]] = {
    "unicycles": {**BAD, "duration": 16.0},
    "formation3d": {**BAD, "duration": 40.0},
    "swarm2d": {"duration": 10.0},
    "faults/turn": BAD,
}
"""With the network's faults, where the scenario has none, and the first part of long ones [s]."""
_TIMEOUT = 300.0
"""[s]: on a busy machine cbfpy compiles for longer than a controller may think."""
_UNFIT = ("orca needs", "cbfpy is for")
"""In the errors of controllers that cannot serve a scenario's agents."""
METRICS = {
    "input_deviation_mean": "‖u − u_nom‖",
    "tracking_error_mean": "from the goal [m]",
    "least_distance": "least distance [m]",
    "deadlock_time": "deadlock [s]",
}
"""Of Run.metrics, the swarm's, by title."""


class Result(msgspec.Struct):
    """The result of one run."""

    outcome: str
    certified: float
    """Share of the normal agents' inputs that were certified until the next sample."""
    worst: float
    """Largest h_tot."""
    step: float
    """Median wall time of an agent's step [s]."""
    metrics: dict[str, float | None]
    """Of the swarm, in the order of METRICS."""


def main() -> None:
    """Run what is missing, seed by seed, and print a table for each scenario."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--only", choices=SCENARIOS, action="append", help="of the scenarios")
    arguments.add_argument("--whole", action="store_true", help="whole runs")
    options = arguments.parse_args()
    names = options.only or list(SCENARIOS)
    results = {
        (seed, name, title): of_run(seed, name, title, options.whole)
        for seed, name, title in itertools.product(range(options.seeds), names, CONTROLLERS)
    }
    for name in names:
        print(f"{name}, {options.seeds} seeds\n\n{_HEAD}")
        for title in CONTROLLERS:
            print(row(title, [results[seed, name, title] for seed in range(options.seeds)]))
        print(flush=True)


def settings(name: str, title: str, whole: bool = False) -> dict[str, Any]:
    """Return the overrides of a scenario and a controller; whole: for its own duration."""
    overrides = {**SCENARIOS[name], **CONTROLLERS[title], "time.timeout": _TIMEOUT}
    return {k: v for k, v in overrides.items() if not (whole and k == "duration")}


def of_run(seed: int, name: str, title: str, whole: bool) -> Result | None:
    """Return the kept result of a run, or that of a new one; None if the controller cannot run."""
    words = [name.replace("/", "-"), *title.split(), *["whole"] * whole, str(seed)]
    path = KEPT / f"{'-'.join(words)}.json"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(msgspec.json.encode(measured(name, settings(name, title, whole), seed)))
    return msgspec.json.decode(path.read_bytes(), type=Result | None)


def simulated(name: str, overrides: dict[str, Any], seed: int) -> phalanx.Run | None:
    """Run once, in this process; None if the controller does not fit the scenario."""
    try:
        return phalanx.run(phalanx.load(name, overrides, seed=seed), engine="in-process")
    except phalanx.ScenarioError as error:
        if any(words in str(error) for words in _UNFIT):
            return None
        raise


def measured(name: str, overrides: dict[str, Any], seed: int) -> Result | None:
    """Measure one run; None if the controller does not fit the scenario."""
    if (run := simulated(name, overrides, seed)) is None:
        return None
    summary = run.summary
    assert summary is not None
    table = run.metrics
    swarm = table.filter(table["role"] == "swarm")
    certificates = summary.certificates
    inputs = run.inputs
    return Result(
        summary.outcome,
        certificates.certified / max(1, certificates.samples),
        summary.largest_h_tot,
        float(np.median(inputs.filter(inputs["origin"] != "attack")["solve_time"].to_numpy())),
        swarm.select(list(METRICS)).to_dicts()[0],
    )


_HEAD = (
    "| controller | guaranteed | safe | violated | certified | largest h_tot | "
    f"{' | '.join(METRICS.values())} | step [ms] |\n|{'---|' * (7 + len(METRICS))}"
)


def row(title: str, results: list[Result | None]) -> str:
    """Return a controller's row: sums of the verdicts, the largest h_tot, means, least distance."""
    some = [result for result in results if result is not None]
    if len(some) < len(results):
        return f"| {title} | does not fit |{' |' * (5 + len(METRICS))}"
    counts = Counter(result.outcome for result in some)
    share = statistics.mean(r.certified for r in some)
    cells = [
        *(str(counts[o]) for o in (Outcome.GUARANTEED, Outcome.SAFE, Outcome.VIOLATED)),
        f"{share:.2%}",
        f"{max(r.worst for r in some):.3g}",
        *(_metric(name, [r.metrics[name] for r in some]) for name in METRICS),
        f"{1e3 * statistics.median(r.step for r in some):.2f}",
    ]
    return f"| {title} | {' | '.join(cells)} |"


def _metric(name: str, values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    return f"{min(known) if name.startswith('least') else statistics.mean(known):.2f}"


if __name__ == "__main__":
    main()
