"""Compare controllers on the same scenarios, seeds, network and nominal law.

    pip install -e '.[bench]' pyrvo
    python evidence/controllers/compare.py --seeds 20 --only unicycles --duration 16

Every result is a file under build/controllers, written as soon as it is there; what is there is not
run again. Delete the folder after a change that moves trajectories. The tables go to the terminal.
"""

import argparse
import statistics
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import phalanx
from phalanx.arrays import Array
from phalanx.guarantee.verdict import Outcome
from phalanx.swarm.swarm import build_swarm

KEPT = Path("build/controllers")
CONTROLLERS: dict[str, dict[str, Any]] = {
    "the paper's filter": {},
    "Shield": {"agents.0.controller.type": "shield:Shield"},
    "cbf-qp": {"agents.0.controller.type": "cbf-qp"},
    "cbfpy": {"agents.0.controller.type": "cbfpy_filter:CbfPy"},
    "orca": {"agents.0.controller.type": "orca"},
    "escape": {"agents.0.controller.type": "escape"},
    "none": {"agents.0.controller.type": "none"},
}
BAD = {"network.loss": 0.2, "network.delay": {"low": 0.0, "high": 0.05}}
SCENARIOS: dict[str, dict[str, Any]] = {
    "unicycles": BAD,
    "formation3d": BAD,
    "swarm2d": {},
    "faults/turn": BAD,
}
"""With the network's faults, where the scenario has none."""
_UNFIT = ("needs a planar agent", "is for integrators and unicycles")
"""In the errors of controllers that cannot serve a scenario's agents."""
_COMPILING = {"time.timeout": 120.0}
"""JAX takes its time to compile [s]."""
_EVERY = 0.1
"""Time between two states of which the distance to the goal counts [s]."""


class Result(msgspec.Struct):
    """The result of one run."""

    outcome: str
    certified: float
    """Share of the normal agents' inputs that were certified until the next sample."""
    worst: float
    """Largest h_tot."""
    changed: float
    """Mean ‖u − u_nom‖ of normal agents, with u_nom as the law wants it, also outside U_i."""
    goal: float
    """Mean distance of normal agents from their goals [m]."""
    solve: float
    """Median wall time of a normal agent's step [s]."""


def main() -> None:
    """Run what is missing, and print a table for each scenario."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--only", choices=SCENARIOS, action="append", help="of the scenarios")
    arguments.add_argument("--duration", type=float, help="[s], instead of the scenario's")
    options = arguments.parse_args()
    for name in options.only or SCENARIOS:
        duration = {} if options.duration is None else {"duration": options.duration}
        results = {
            title: [of_run(name, title, seed, duration) for seed in range(options.seeds)]
            for title in CONTROLLERS
        }
        print(table(name, results, options.seeds), flush=True)


def of_run(name: str, title: str, seed: int, duration: dict[str, float]) -> Result | None:
    """Return the kept result of a run, or that of a new one; None if the controller cannot run."""
    words = [name.replace("/", "-"), *title.replace(",", "").split(), *map(str, duration.values())]
    path = KEPT / f"{'-'.join(words)}-{seed}.json"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        overrides = {**SCENARIOS[name], **CONTROLLERS[title], **_COMPILING, **duration}
        path.write_bytes(msgspec.json.encode(measured(name, overrides, seed)))
    return msgspec.json.decode(path.read_bytes(), type=Result | None)


def measured(name: str, overrides: dict[str, Any], seed: int) -> Result | None:
    """Run once, in this process; None if the controller does not fit the scenario."""
    try:
        run = phalanx.run(phalanx.load(name, overrides, seed=seed), engine="in-process")
    except phalanx.ScenarioError as error:
        if any(words in str(error) for words in _UNFIT):
            return None
        raise
    summary = run.summary
    assert summary is not None
    swarm = build_swarm(run.scenario)
    names = [swarm.names[i] for i in swarm.normal]
    inputs = run.inputs.filter(run.inputs["agent"].is_in(names))
    columns = [c.partition(".")[2] for c in inputs.columns if c.startswith("u.")]
    u, wanted = (inputs[[f"{k}.{c}" for c in columns]].to_numpy() for k in ("u", "nominal"))
    found = summary.certificates
    return Result(
        summary.outcome,
        found.certified / max(1, found.samples),
        summary.worst_h_tot,
        float(np.nanmean(np.sqrt(np.nansum((u - wanted) ** 2, axis=1)))),
        distance_to_goal(run, swarm),
        float(np.median(inputs["solve_time"].to_numpy())),
    )


def distance_to_goal(run: phalanx.Run, swarm: Any) -> float:
    """Return the mean distance of normal agents from their goals [m]."""
    goals = {i: swarm.goal(i) for i in swarm.normal}
    found, due = list[float](), 0.0
    for state in run.recording.states:
        if state.t < due:
            continue
        due = state.t + _EVERY
        x: Array = np.array(state.x)
        points = swarm.positions(x)
        states = {l: x[part] for l, part in enumerate(swarm.safe_set.parts)}
        found += [
            float(np.linalg.norm(points[i] - goal(state.t, states).position))
            for i, goal in goals.items()
        ]
    return statistics.mean(found)


def table(name: str, results: dict[str, list[Result | None]], seeds: int) -> str:
    """Return the table of a scenario."""
    rows = [
        f"{name}, {seeds} seeds",
        "",
        "| controller | guaranteed | safe | violated | certified | largest h_tot | "
        "‖u − u_nom‖ | from the goal [m] | step [ms] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for title, each in results.items():
        if None in each:
            rows.append(f"| {title} | does not fit |  |  |  |  |  |  |  |")
            continue
        some = [result for result in each if result is not None]
        counts = Counter(result.outcome for result in some)
        share = statistics.mean(r.certified for r in some)
        cells = [
            *(str(counts[o]) for o in (Outcome.GUARANTEED, Outcome.SAFE, Outcome.VIOLATED)),
            f"{share:.2%}",
            f"{max(r.worst for r in some):.3g}",
            f"{statistics.mean(r.changed for r in some):.2f}",
            f"{statistics.mean(r.goal for r in some):.2f}",
            f"{1e3 * statistics.median(r.solve for r in some):.2f}",
        ]
        rows.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join([*rows, ""])


if __name__ == "__main__":
    main()
