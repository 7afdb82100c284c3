"""The coordinator of a study: which jobs it hands out, again or never, and what its rows say."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pytest
from phalanx_studies.coordinator import Coordinator, StudyProgress, identity_of
from phalanx_studies.plan import plan_from
from phalanx_studies.row import Row, digest_of_scenario
from phalanx_studies.store import Store
from phalanx_studies.work import MOST_ATTEMPTS, Job, compute

from phalanx.scenario.load import load

PLAN = {"scenario": "guaranteed", "overrides": {"duration": 0.02}}


class Here(Executor):
    """Computes in this process, and changes results as a test asks for."""

    def __init__(self, then: Callable[[list[Row]], list[Row]] = lambda rows: rows) -> None:
        """then: takes the rows; what it raises is the future's."""
        self.jobs: list[Job] = []
        self._then = then

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> "Future[Any]":
        self.jobs.append(args[0])
        future: Future[Any] = Future()
        try:
            future.set_result(self._then(compute(args[0])))
        except OSError as error:
            future.set_exception(error)
        return future

    @property
    def sizes(self) -> list[int]:
        """Runs in each job that was computed."""
        return [len(job.identities) for job in self.jobs]


def run(folder: Path, executor: Executor, plan: Any = PLAN, **options: Any) -> pl.DataFrame:
    """Execute a plan; return its rows."""
    chosen = {"in_flight": 2, "chunk": 8, "progress": lambda _: None} | options
    with Store(folder).open(plan_from(plan)) as store:
        Coordinator(plan_from(plan), store, executor, **chosen).run()
        return store.frame()


@pytest.mark.slow
def test_runs_are_handed_out_in_jobs_of_a_chunk(tmp_path):
    executor = Here()
    run(tmp_path, executor, {**PLAN, "seeds": "0:5"}, chunk=2)
    assert executor.sizes == [2, 2, 1]


@pytest.mark.slow
def test_the_runs_of_a_job_whose_worker_died_are_tried_again_each_alone(tmp_path):
    def dies_first(rows: list[Row]) -> list[Row]:
        if len(rows) > 1:
            raise OSError("its worker died")
        return rows

    executor = Here(dies_first)
    frame = run(tmp_path, executor, {**PLAN, "seeds": "0:3"})
    assert executor.sizes == [3, 1, 1, 1]
    assert "broken" not in set(frame["outcome"])


def test_a_run_whose_workers_always_die_is_given_up(tmp_path):
    def dies(rows: list[Row]) -> list[Row]:
        raise OSError("its worker died")

    executor = Here(dies)
    (row,) = run(tmp_path, executor).iter_rows(named=True)
    assert len(executor.jobs) == MOST_ATTEMPTS
    assert row["outcome"] == "broken"
    assert row["reason"] == "tried 3 times: OSError: its worker died"


@pytest.mark.slow
def test_a_seed_without_room_for_its_starts_is_refused_alone(tmp_path):
    crowded = {"flows.apart": 6.8, "duration": 0.02}
    plan = {"scenario": "swarm2d", "seeds": [1, 0], "overrides": crowded}
    plan_from(plan).require_axes()
    frame = run(tmp_path, Here(), plan)
    refused = {row["seed"]: row["outcome"] == "refused" for row in frame.iter_rows(named=True)}
    assert refused == {1: True, 0: False}


def again(folder: Path, change: Callable[[Row], Row]) -> int:
    """Return how many runs of two a second execution computes, after a change of each row."""
    plan, executor = {**PLAN, "seeds": "0:2"}, Here()
    with Store(folder).open(plan_from(plan)) as store:
        for case in plan_from(plan).cases():
            identity, *_ = identity_of(plan_from(plan), case)
            overrides = case.point.overrides
            store.add(
                change(Row(identity=identity, overrides=overrides, outcome="safe", reason=""))
            )
    run(folder, executor, plan)
    return sum(executor.sizes)


@pytest.mark.parametrize(
    ("changed", "computed"),
    [({}, 0), ({"scenario": "other"}, 2), ({"modules": "other"}, 2), ({"versions": "other"}, 2)],
)
def test_a_row_serves_again_where_all_that_it_follows_from_is_the_same(tmp_path, changed, computed):
    def change(row: Row) -> Row:
        return msgspec.structs.replace(row, identity=row.identity._replace(**changed))

    assert again(tmp_path, change) == computed


def test_a_run_that_cannot_begin_has_a_row_and_progress_counts_every_row(tmp_path):
    points = [{"network.loss": 2.0}, {"network.loss": 0.5}]
    progress: list[StudyProgress] = []
    for _ in range(2):  # the second time all rows are there
        frame = run(tmp_path, Here(), {**PLAN, "points": points}, progress=progress.append)
        assert list(frame["outcome"]) == ["refused", "guaranteed"]
    assert progress[0] == (1, 2, {"refused": 1}, 0)
    assert [state for state in progress if state.computed] == [
        (2, 2, {"refused": 1, "guaranteed": 1}, 1)
    ]
    assert progress[-1] == (2, 2, {"refused": 1, "guaranteed": 1}, 0)


def test_a_broken_run_is_tried_again(tmp_path):
    assert again(tmp_path, lambda row: msgspec.structs.replace(row, outcome="broken")) == 2


def test_the_digest_follows_the_meaning_of_a_scenario_and_not_its_text():
    scenario = load("unicycles")
    assert digest_of_scenario(scenario) == digest_of_scenario(load("unicycles", seed=5))
    given = load("unicycles", {"network.loss": 0.0, "description": "another"})
    assert digest_of_scenario(scenario) == digest_of_scenario(given)
    assert digest_of_scenario(scenario) != digest_of_scenario(load("unicycles", {"duration": 1.0}))


@pytest.mark.parametrize("scenario", ["swarm2d", "formation3d"])
def test_a_runs_key_does_not_depend_on_the_other_seeds_of_its_plan(scenario):
    """Starts of the one and obstacles of the other are drawn for each seed."""
    keys = []
    for seeds in ([0, 5], [5, 0]):
        plan = plan_from({"scenario": scenario, "seeds": seeds})
        identity, *_ = identity_of(plan, next(plan.cases()))
        keys.append(identity._replace(seed=0).key)
    assert keys[0] == keys[1]


def test_a_row_follows_from_the_file_of_a_users_own_program(tmp_path):
    file = tmp_path / "agent.py"
    given = {"agents.0.program": ["python", str(file)], "agents.0.filter": True}
    plan, keys = plan_from({"scenario": "warehouse", "overrides": given}), set()
    for text in ("one", "another"):
        file.write_text(text)
        identity, *_ = identity_of(plan, next(plan.cases()))
        keys.add(identity.key)
    assert len(keys) == 2
