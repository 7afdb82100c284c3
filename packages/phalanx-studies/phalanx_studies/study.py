"""phalanx.study: many runs of one scenario, as a table of one row each.

A study is declared as a plan, kept in a folder, and executed by any Executor. Asked again it runs
what is missing, whatever ended it before.
"""

import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any

import polars as pl

from phalanx.cli.display import progress_of_runs
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.engine import DEFAULT_ENGINE, require_functions, silent
from phalanx.launcher.run import Run
from phalanx.launcher.run import run as run_scenario
from phalanx.scenario.model import Scenario
from phalanx.schema.registry import as_table
from phalanx_studies.coordinator import Coordinator, Progress, StudyProgress
from phalanx_studies.plan import Plan, as_text, plan_from, read_plan
from phalanx_studies.pool import Pool
from phalanx_studies.row import counted, json_text
from phalanx_studies.statistics import rate
from phalanx_studies.store import PLAN, Store


def study(
    scenario: Scenario | Plan | str | Path | Mapping[str, Any],
    *,
    seeds: int | str | Iterable[int] = 1,
    vary: Mapping[str, Sequence[Any]] | None = None,
    points: Sequence[Mapping[str, Any]] = (),
    draw: Mapping[str, Mapping[str, Any]] | None = None,
    draws: int | None = None,
    overrides: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    in_flight: int | None = None,
    chunk: int = 1,
    progress: Progress | bool = False,
) -> "Study":
    """Run a scenario for every seed and every point of a grid, and return the rows.

    Args:
        scenario: as load takes it, or a Plan, or the path of a study.toml; with these two the
            arguments up to overrides are in it.
        seeds: their number, "0:200", or themselves.
        vary: the values of each axis, by its field's path; all combinations are run.
        points: fields by path, one mapping for each point.
        draw: fields drawn at random, by path: {"uniform": (a, b)}, {"log-uniform": (a, b)} or
            {"choice": values}.
        draws: the number of draws, each with every seed.
        overrides: fields of every run.
        out: the study's folder; by default a temporary one. What is there already is not run again.
        workers: of the built-in pool; by default one for each processor.
        executor: computes the rows in place of the pool, for example dask.distributed's.
        in_flight: most jobs handed to the executor at a time; by default two for each worker.
        chunk: runs in a job; more of them where jobs travel far.
        progress: True for a bar with the remaining time, in a terminal or a notebook, and for some
            lines elsewhere; or a function, called with a StudyProgress after each job.

    Returns:
        The study, whole; Ctrl-C raises KeyboardInterrupt, and keeps what was finished.

    Raises:
        ScenarioError: the plan or the scenario is not valid at any point.
        StudyError: the folder belongs to another program, or another version of Phalanx.
        OSError: the folder cannot be written.
    """
    if not isinstance(progress, bool):
        require_functions(progress=progress)
    if isinstance(scenario, Plan):
        plan = scenario
    elif isinstance(scenario, str | Path) and Path(scenario).name == PLAN:
        plan = read_plan(Path(scenario))
    else:
        table = {
            "scenario": _source(scenario),
            "seeds": _seeds(seeds),
            "overrides": _tables(overrides or {}),
            "vary": {path: [as_table(v) for v in values] for path, values in (vary or {}).items()},
            "points": [_tables(point) for point in points],
            "draw": {path: dict(distribution) for path, distribution in (draw or {}).items()},
            "draws": draws,
        }
        plan = plan_from(table)
    plan.require_axes()
    temporary = tempfile.TemporaryDirectory(prefix="phalanx-study-") if out is None else None
    folder = Path(temporary.name if temporary else out or "")
    with (
        Store(folder).open(plan) as store,
        nullcontext(executor) if executor else Pool(workers) as computing,
        _display(plan, progress) as show,
    ):
        most = in_flight or 2 * (computing.workers if isinstance(computing, Pool) else 8)
        Coordinator(plan, store, computing, most, chunk, show).run()
    return Study(folder, plan, temporary)


def open_study(folder: str | Path) -> "Study":
    """Open a study's folder, whole or unfinished. Raises ScenarioError, StudyError."""
    return Study(Path(folder), read_plan(Path(folder) / PLAN))


@contextmanager
def _display(plan: Plan, progress: Progress | bool) -> Iterator[Progress]:
    """Yield the function to call with the progress; True: shows it while the block runs."""
    if progress is not True:
        yield progress or silent
        return
    with progress_of_runs(plan.size) as show:

        def update(state: StudyProgress) -> None:
            counts = (f"{n} {outcome}" for outcome, n in state.outcomes.most_common())
            show(plan.name, state.done, ", ".join(counts))

        yield update


class Study:
    """The rows of a study."""

    def __init__(
        self,
        folder: Path,
        plan: Plan,
        temporary: "tempfile.TemporaryDirectory[str] | None" = None,
    ) -> None:
        """temporary: removes the folder with this object."""
        self.folder, self.plan = folder, plan
        self._temporary = temporary

    @property
    def axes(self) -> list[str]:
        """Paths of the fields in which points differ: columns of `frame`."""
        return self.plan.axes

    @cached_property
    def frame(self) -> pl.DataFrame:
        """One row for each run that is there: index, point, seed, the axes, and its results.

        Where `faults` is an axis, those that had an effect are `faults_acted`.
        """
        points = [self.plan.point(number) for number in range(self.plan.points_count)]
        table = pl.DataFrame(
            {
                "point": [point.number for point in points],
                "overrides": [json_text(point.overrides) for point in points],
                **{axis: [as_text(point.axes.get(axis)) for point in points] for axis in self.axes},
            },
            strict=False,
        )
        cases = pl.DataFrame(
            {
                "index": range(self.plan.size),
                "point": [n for n in range(len(points)) for _ in self.plan.seeds],
                "seed": [*self.plan.seeds] * len(points),
            }
        )
        rows = Store(self.folder).frame()
        latest = rows.unique(["overrides", "seed"], keep="last", maintain_order=True)
        frame = cases.join(table, on="point").join(
            latest, on=["overrides", "seed"], suffix="_acted"
        )
        return frame.sort("index").drop("scenario", "modules", "versions")

    @property
    def outcomes(self) -> Counter[str]:
        """Number of rows by outcome."""
        return Counter(self.frame["outcome"].to_list())

    @property
    def missing(self) -> int:
        """Number of runs without a row."""
        return self.plan.size - len(self.frame)

    def rates(
        self, outcome: str = Outcome.VIOLATED, by: Sequence[str] | None = None, level: float = 0.95
    ) -> pl.DataFrame:
        """Return an outcome's rate, with its interval, at each value of the axes.

        The interval is exact for the number of runs of the plan (Clopper and Pearson). Where
        several runs share a seed, seeds are the draws. Rows that a search chose do not count, nor
        those that were refused.

        Args:
            outcome: "violated", "guaranteed", ...
            by: axes; by default all.
            level: of the intervals.
        """
        axes = self.axes if by is None else list(by)
        runs = counted(self.frame)
        grouped = runs.group_by(axes, maintain_order=True) if axes else [((), runs)]
        rates = []
        for values, rows in grouped:
            hits = (rows["outcome"] == outcome).to_numpy()
            share, (low, high), n = rate(hits, rows["seed"].to_numpy(), level)
            point = dict(zip(axes, values, strict=True))
            counts = {"runs": n, outcome: round(share * n)}
            rates.append({**point, **counts, "rate": share, "low": low, "high": high})
        return pl.DataFrame(rates)

    def run(
        self, index: int, *, engine: str = DEFAULT_ENGINE, out: str | Path | None = None
    ) -> Run:
        """Run a row again, with its recording; engine and out as phalanx.run takes them."""
        return run_scenario(self.plan.load(self.plan.case(index)), engine=engine, out=out)

    def confirm(self, share: float) -> dict[int, bool]:
        """Repeat a share of the rows over processes, spread evenly; at least one.

        Returns by index whether the trajectory has the row's hash.
        """
        runs = self.frame.filter(pl.col("trajectory") != "").select("index", "trajectory").rows()
        every = max(1, round(1.0 / share))
        return {
            index: (summary := self.run(index).summary) is not None
            and summary.trajectory == trajectory
            for index, trajectory in runs[::every]
        }

    def command(self, index: int) -> str:
        """Return the command that runs a row again."""
        return self.plan.command(self.plan.case(index))

    def page(self, path: str | Path | None = None) -> Path:
        """Write the study as one HTML file, by default study.html in its folder; return its path.

        Raises OSError.
        """
        from phalanx_studies.page.write import write_study_page

        return write_study_page(
            self.frame, self.axes, self.folder.name, Path(path or self.folder / "study.html"),
            lambda row: self.command(row["index"]),
        )  # fmt: skip

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {outcome}" for outcome, n in self.outcomes.most_common())
        return f"Study({str(self.folder)!r}, {counts or 'no rows'})"

    def _repr_html_(self) -> str:
        """Return the rates over each axis for a notebook."""
        from phalanx_studies.page.write import study_rates

        return study_rates(self.frame, self.axes)


def _source(scenario: Scenario | str | Path | Mapping[str, Any]) -> Any:
    if isinstance(scenario, Scenario):
        return scenario.model_dump(mode="json", by_alias=True, exclude={"reading", "seed"})
    return str(scenario) if isinstance(scenario, str | Path) else dict(scenario)


def _seeds(seeds: int | str | Iterable[int]) -> str | list[int]:
    if isinstance(seeds, str):
        return seeds
    return list(range(seeds)) if isinstance(seeds, int) else list(seeds)


def _tables(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {path: as_table(value) for path, value in fields.items()}
