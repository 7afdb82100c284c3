"""Fly scenario `worlds/crazyflies` over many seeds, and print verdicts and disturbances.

    pip install -e '.[drone-models]'
    python evidence/worlds/crazyflies.py --seeds 20 --picture docs/images/crazyflies.png

A study whose rows also keep the disturbances that explain each run: build/crazyflies has both, and
what is there is not run again. Delete the folder after a change that moves trajectories.
"""

import argparse
import multiprocessing
from collections import Counter
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from declared import needed_by

import phalanx
from phalanx.arrays import Array
from phalanx.launcher.in_process_engine import RecordsInMemory, simulate
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import Recording, swarm_of
from phalanx.recording.records import State, Step
from phalanx.studies.identity import Identity
from phalanx.studies.row import Row, row_of
from phalanx.studies.work import Job, row_by
from phalanx.swarm.rows import SafetyRows

SCENARIO, KEPT = "worlds/crazyflies", Path("build/crazyflies")
RADIUS, DECLARED = 0.4, 0.1
"""Those of the scenario [m], [m/s²]."""


def point(margin: str, bound: float) -> dict[str, Any]:
    """Return the fields in which variants differ."""
    bounds = {f"agents.{group}.disturbance.bound": bound for group in (0, 1)}
    return {"safety.margin": margin, "safety.eta": 0.0, **bounds}


VARIANTS = {
    "as shipped": point("integrated", DECLARED),
    "η = 0": point("paper", DECLARED),
    "φ declared half": point("integrated", DECLARED / 2),
}


class KeepingDisturbances(ProcessPoolExecutor):
    """Processes whose jobs keep the disturbances of their runs as files."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Compute a study's job."""
        return super().submit(rows_of, *args)


def rows_of(job: Job) -> list[Row]:
    """Return the rows of a job's runs."""
    return [row_by(_kept, job, identity) for identity in job.identities]


def _kept(job: Job, identity: Identity, rows: SafetyRows) -> Row:
    records = RecordsInMemory()
    summary = simulate(rows, records)
    states, steps = records.of(State), records.of(Step)
    recording = Recording(Path(), rows.swarm.scenario, {}, states, steps)
    found = disturbances_of(recording, rows.swarm)
    np.save(sizes_at(identity.key), np.concatenate([each.size for each in found]))
    return row_of(identity, job.overrides, summary, recording, rows.swarm)


def sizes_at(key: str) -> Path:
    """Return the file of a run's disturbances."""
    return KEPT / f"{key}.npy"


def main() -> None:
    """Run what is missing; print the table, and what other declarations need."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--workers", type=int, help="processes; by default one per processor")
    arguments.add_argument("--picture", type=Path, help="file of the figure")
    options = arguments.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    # A fork would share the state of libraries that start threads.
    spawn = multiprocessing.get_context("spawn")
    with KeepingDisturbances(options.workers, mp_context=spawn) as executor:
        study = phalanx.study(
            SCENARIO,
            seeds=options.seeds,
            points=[*VARIANTS.values()],
            out=KEPT,
            executor=executor,
            confirm=0.0,
            progress=True,
        )
    print(HEAD)
    for number, (title, fields) in enumerate(VARIANTS.items()):
        runs = study.frame.filter(pl.col("point") == number)
        print(line(title, runs, fields["agents.0.disturbance.bound"]))
    run = study.run(0, engine="in-process")
    print(f"\n{OTHERS}")
    for title, sizes in needed_by(run).items():
        print(cells(title, *shares(sizes)))
    if options.picture:
        picture(run, options.picture)


HEAD = """\
| variant | runs | verdicts | φ declared | φ needed: 50 % | 99 % | largest | least distance [m] | \
worst h [m²] |
|---|---|---|---|---|---|---|---|---|"""
OTHERS = """\
| declared, for the same inputs | φ needed: 50 % | 99 % | largest |
|---|---|---|---|"""


def line(title: str, runs: pl.DataFrame, declared: float) -> str:
    """Return a variant's line: all its runs, and all their intervals."""
    counts = Counter(runs["outcome"].to_list())
    verdicts = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    sizes = np.concatenate([np.load(sizes_at(key)) for key in runs["key"]])
    least = float(runs["least_distance"].to_numpy().min())
    worst = f"{RADIUS**2 - least**2:.4f}"
    return cells(title, len(runs), verdicts, declared, *shares(sizes), f"{least:.3f}", worst)


def shares(sizes: Array) -> list[str]:
    """Return the bounds that half and 99 % of the intervals keep, and the largest."""
    return [f"{value:.4f}" for value in (*np.quantile(sizes, [0.5, 0.99]), sizes.max())]


def cells(*values: object) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(map(str, values))} |"


def picture(run: phalanx.Run, path: Path) -> None:
    """Draw paths, and the disturbances that explain them with the declared bounds."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    run.plot("paths", axes={"paths": left})
    swarm = swarm_of(run.recording)
    explained = disturbances_of(run.recording, swarm)
    for name, found in zip(swarm.names, explained, strict=True):
        right.plot(found.t, found.size, linewidth=0.8, label=name)
    right.axhline(DECLARED, color="black", linewidth=1.0, label="declared")
    right.axhline(DECLARED / 2, color="black", linewidth=1.0, linestyle=":", label="half")
    right.set(xlabel="t [s]", ylabel="‖φ̂‖ [m/s²]", ylim=(0.0, 1.1 * DECLARED))
    right.legend(fontsize="small", ncols=2)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
