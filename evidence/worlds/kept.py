"""A study of a world, whose rows also keep the disturbances that explain each run."""

import argparse
import multiprocessing
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from phalanx_studies.row import Identity, Row, row_of
from phalanx_studies.study import Study
from phalanx_studies.work import Job, compute

import phalanx
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import swarm_of
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array


class Variant(NamedTuple):
    """The runs of one variant of a scenario."""

    runs: pl.DataFrame
    sizes: Array
    """‖φ̂‖ of all their intervals."""

    @property
    def verdicts(self) -> str:
        """Numbers of runs by outcome."""
        counts = Counter(self.runs["outcome"].to_list())
        return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))

    @property
    def least_distance(self) -> float:
        """The least of all runs [m]."""
        return float(self.runs["least_distance"].to_numpy().min())


def arguments(doc: str | None) -> argparse.Namespace:
    """Read the command line of a study."""
    parser = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="seeds 0 to SEEDS - 1")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--picture", type=Path, help="file of the figure")
    return parser.parse_args()


def studied(
    scenario: str, variants: Mapping[str, dict[str, Any]], options: argparse.Namespace
) -> tuple[Study, dict[str, Variant]]:
    """Run what is missing, and return all runs by variant; variants: fields that differ."""
    folder = Path("build") / scenario
    folder.mkdir(parents=True, exist_ok=True)
    # A fork would share the state of libraries that start threads.
    spawn = multiprocessing.get_context("spawn")
    with _KeepingDisturbances(options.workers, mp_context=spawn) as executor:
        executor.folder = folder
        study = phalanx.study(
            scenario,
            seeds=options.seeds,
            points=[*variants.values()],
            out=folder,
            executor=executor,
            progress=True,
        )
    if broken := study.frame.filter(pl.col("outcome") == "broken")["reason"].to_list():
        raise SystemExit(f"{len(broken)} runs are broken: {broken[0]}")
    results = {}
    for number, title in enumerate(variants):
        runs = study.frame.filter(pl.col("point") == number)
        results[title] = Variant(
            runs, np.concatenate([np.load(folder / f"{key}.npy") for key in runs["key"]])
        )
    return study, results


class _KeepingDisturbances(ProcessPoolExecutor):
    """Processes whose jobs keep the disturbances of their runs as files."""

    folder: Path

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Compute a study's job."""
        return super().submit(partial(compute, work=partial(_row, self.folder)), *args)


def _row(folder: Path, job: Job, identity: Identity, rows: SafetyRows) -> Row:
    records = RecordsInMemory()
    summary = Simulation(rows, records).run()
    recording = records.recording(rows.swarm.scenario)
    ledgers = disturbances_of(recording, rows.swarm)
    np.save(folder / f"{identity.key}.npy", np.concatenate([each.size for each in ledgers]))
    return row_of(identity, job.overrides, summary, recording, rows.swarm)


def shares(sizes: Array) -> list[str]:
    """Return the bounds that half and 99 % of the intervals keep, and the largest."""
    return [f"{value:.4f}" for value in (*np.quantile(sizes, [0.5, 0.99]), sizes.max())]


def cells(*values: object) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(map(str, values))} |"


def draw_disturbances(run: phalanx.Run, axes: Any) -> None:
    """Draw the disturbances that explain each agent's motion."""
    swarm = swarm_of(run.recording)
    explained = disturbances_of(run.recording, swarm)
    for name, explanation in zip(swarm.names, explained, strict=True):
        axes.plot(explanation.t, explanation.size, linewidth=0.8, label=name)
