"""Drive scenario `worlds/rovers` over many seeds, with and without failures; print verdicts and φ.

    pip install -e '.[mujoco]'
    python evidence/worlds/rovers.py --seeds 20

A study whose rows also keep the disturbances that explain each run: build/rovers has both, and
what is there is not run again. Delete the folder after a change that moves trajectories.
"""

import argparse
import multiprocessing
from collections import Counter
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import phalanx
from phalanx.launcher.in_process_engine import RecordsInMemory, simulate
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import Recording
from phalanx.recording.records import State, Step
from phalanx.studies.identity import Identity
from phalanx.studies.row import Row, row_of
from phalanx.studies.work import Job, row_by
from phalanx.swarm.rows import SafetyRows

SCENARIO, KEPT, DECLARED, ROLLING = "worlds/rovers", Path("build/rovers"), 0.25, 0.05
"""The last two are the scenario's."""


def point(
    duration: float, margin: str = "integrated", bound: float = DECLARED, **failed: Any
) -> dict[str, Any]:
    """Return the fields in which variants differ; a failure is agent 1's."""
    bounds = {f"agents.{group}.disturbance.bound": bound for group in (0, 1)}
    failures = [{"agent": "1", **failed}] if failed else []
    world = {"type": "mujoco", "rolling": ROLLING, "failures": failures}
    return {
        "safety.margin": margin,
        "safety.eta": 0.0,
        "world": world,
        "duration": duration,
        **bounds,
    }


VARIANTS = {
    "as shipped": point(24.0),
    "η = 0": point(24.0, margin="paper"),
    "φ declared half": point(6.0, bound=DECLARED / 2),
    "mass doubled at 0.5 s, accelerating": point(6.0, at=0.5, mass=2.0),
    "mass doubled at 2 s, at constant speed": point(6.0, at=2.0, mass=2.0),
    "left wheel stuck at 2 s": point(6.0, at=2.0, wheel="left"),
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
    """Run what is missing, and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--workers", type=int, help="processes; by default one per processor")
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


HEAD = """\
| variant | runs | verdicts | disturbance bound failed | φ declared | φ needed: 50 % | 99 % \
| largest | least distance [m] | worst h_tot |
|---|---|---|---|---|---|---|---|---|---|"""


def line(title: str, runs: pl.DataFrame, declared: float) -> str:
    """Return a variant's line: all its runs, and all their intervals."""
    counts = Counter(runs["outcome"].to_list())
    verdicts = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    failed = sum("disturbance bound" in reason for reason in runs["reason"])
    sizes = np.concatenate([np.load(sizes_at(key)) for key in runs["key"]])
    shares = [f"{value:.3f}" for value in (*np.quantile(sizes, [0.5, 0.99]), sizes.max())]
    least, worst = (f"{x:.3f}" for x in (min(runs["least_distance"]), max(runs["worst_h"])))
    cells = [title, len(runs), verdicts, failed, declared, *shares, least, worst]
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
