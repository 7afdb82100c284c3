"""The coordinator of a study: which jobs it hands out, again or never, and what its rows say."""

from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pytest

from phalanx.scenario.load import load
from phalanx.studies.coordinator import Coordinator, Inventory, identity_of, missing_by_reason
from phalanx.studies.plan import plan_from
from phalanx.studies.row import Identity, Row, digest_of_scenario
from phalanx.studies.store import Store
from phalanx.studies.work import MOST_ATTEMPTS, Job, compute, confirm

PLAN = {"scenario": "guaranteed", "overrides": {"duration": 0.02}}
STUDY = plan_from({"scenario": "unicycles", "seeds": "0:3"})


class Here(Executor):
    """Computes in this process, and changes results as a test asks for.

    Both engines have the same bits, so that a repetition is computed in-process too.
    """

    def __init__(self, then: Callable[[Any, list[Row]], list[Row]] = lambda _, rows: rows) -> None:
        """then: takes the function and its rows; what it raises is the future's."""
        self.jobs: list[tuple[Any, Job]] = []
        self._then = then

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> "Future[Any]":
        self.jobs.append((fn, args[0]))
        future: Future[Any] = Future()
        try:
            future.set_result(self._then(fn, compute(args[0])))
        except OSError as error:
            future.set_exception(error)
        return future

    @property
    def sizes(self) -> list[int]:
        """Runs in each job that was computed."""
        return [len(job.identities) for fn, job in self.jobs if fn is compute]


def run(folder: Path, executor: Executor, plan: Any = PLAN, **options: Any) -> pl.DataFrame:
    """Execute a plan; return its rows."""
    chosen = {"in_flight": 2, "chunk": 8, "share": 0.0, "progress": lambda _: None} | options
    with Store(folder).open(plan_from(plan)) as store:
        Coordinator(plan_from(plan), store, executor, **chosen).run()
        return store.frame()


def elsewhere(fn: Any, rows: list[Row]) -> list[Row]:
    """Change the trajectory of a repetition."""
    return [msgspec.structs.replace(row, trajectory="0" * 8) if fn is confirm else row
            for row in rows]  # fmt: skip


@pytest.mark.slow
def test_runs_are_handed_out_in_jobs_of_a_chunk(tmp_path):
    executor = Here()
    run(tmp_path, executor, {**PLAN, "seeds": "0:5"}, chunk=2)
    assert executor.sizes == [2, 2, 1]


@pytest.mark.slow
def test_the_runs_of_a_job_whose_worker_died_are_tried_again_each_alone(tmp_path):
    def dies_first(fn: Any, rows: list[Row]) -> list[Row]:
        if len(rows) > 1:
            raise OSError("its worker died")
        return rows

    executor = Here(dies_first)
    frame = run(tmp_path, executor, {**PLAN, "seeds": "0:3"})
    assert executor.sizes == [3, 1, 1, 1]
    assert "broken" not in set(frame["outcome"])


def test_a_run_whose_workers_always_die_is_given_up(tmp_path):
    def dies(fn: Any, rows: list[Row]) -> list[Row]:
        raise OSError("its worker died")

    executor = Here(dies)
    (row,) = run(tmp_path, executor).iter_rows(named=True)
    assert len(executor.jobs) == MOST_ATTEMPTS
    assert row["outcome"] == "broken"
    assert row["reason"] == "tried 3 times: OSError: its worker died"


@pytest.mark.parametrize(("then", "same"), [(lambda _, rows: rows, True), (elsewhere, False)])
def test_a_row_says_whether_its_run_as_processes_had_the_same_trajectory(tmp_path, then, same):
    frame = run(tmp_path, Here(then), share=1.0)
    assert frame["confirmed"].to_list() == [same]
    assert frame["trajectory"].to_list() != ["0" * 8]


def test_a_repetition_that_fails_leaves_its_row_unconfirmed(tmp_path):
    def fails(fn: Any, rows: list[Row]) -> list[Row]:
        if fn is confirm:
            raise OSError("no port is free")
        return rows

    frame = run(tmp_path, Here(fails), share=1.0)
    assert frame["confirmed"].to_list() == [None]
    assert frame["outcome"].to_list() == ["guaranteed"]


@pytest.mark.slow
def test_violated_runs_are_repeated_whatever_the_share_and_only_so_many(tmp_path):
    def violated(fn: Any, rows: list[Row]) -> list[Row]:
        return [msgspec.structs.replace(row, outcome="violated") for row in rows]

    executor = Here(violated)
    run(tmp_path, executor, {**PLAN, "seeds": "0:23"}, share=1e-9)
    assert Counter(fn for fn, _ in executor.jobs)[confirm] == 20


def test_nothing_is_repeated_if_the_share_is_none(tmp_path):
    executor = Here(lambda _, rows: [msgspec.structs.replace(r, outcome="violated") for r in rows])
    run(tmp_path, executor, share=0.0)
    assert [fn for fn, _ in executor.jobs] == [compute]


@pytest.mark.slow
def test_a_point_whose_rate_is_known_needs_no_more_seeds(tmp_path):
    executor = Here()
    run(tmp_path, executor, {**PLAN, "seeds": "0:60", "until_width": 0.2}, chunk=1, in_flight=1)
    assert 20 < len(executor.jobs) < 60


class LateFirst(Here):
    """Executes its first job after all others that it is given meanwhile."""

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> "Future[Any]":
        future = super().submit(fn, *args)
        if len(self.jobs) == 1:
            self._first, future = future, Future()
            self.late = future
        return future

    def progress(self, _: object) -> None:
        """Complete the first job once no other waits: called before each wait, and at the end."""
        if self._jobs_before == len(self.jobs) and not self.late.done():
            self.late.set_result(self._first.result())
        self._jobs_before = len(self.jobs)

    _jobs_before = 0


@pytest.mark.slow
def test_runs_behind_one_that_is_missing_do_not_end_a_point(tmp_path):
    """Count no rate of the quick ones alone, which is biased."""
    executor, plan = LateFirst(), {**PLAN, "seeds": "0:16", "until_width": 0.5}
    run(tmp_path, executor, plan, chunk=1, in_flight=2, progress=executor.progress)
    assert len(executor.jobs) == 16


@pytest.mark.slow
def test_a_seed_without_room_for_its_starts_is_refused_alone(tmp_path):
    crowded = {"flows.apart": 6.8, "duration": 0.02}
    plan = {"scenario": "swarm2d", "seeds": [1, 0], "overrides": crowded}
    plan_from(plan).require_axes()
    frame = run(tmp_path, Here(), plan)
    refused = {row["seed"]: row["outcome"] == "refused" for row in frame.iter_rows(named=True)}
    assert refused == {1: True, 0: False}


@pytest.fixture
def store(tmp_path):
    """Yield an open store."""
    with Store(tmp_path).open(STUDY) as opened:
        yield opened


def stored(store, identity: Identity, outcome: str = "safe", **overrides: object) -> None:
    """Store a row of this identity."""
    store.add(Row(identity=identity, overrides=overrides, outcome=outcome, reason=""))


def test_what_was_never_run_is_new(store):
    assert missing_by_reason(STUDY, store) == {"new": 3}


def test_rows_of_the_same_identity_are_used_again(store):
    identity, *_ = identity_of(STUDY, STUDY.case(0))
    for seed in range(2):
        stored(store, identity._replace(seed=seed))
    assert missing_by_reason(STUDY, store) == {"new": 1}


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"scenario": "other"}, "changed: the scenario"),
        ({"modules": "other"}, "changed: your modules"),
        ({"scenario": "other", "modules": "other"}, "changed: the scenario, your modules"),
    ],
)
def test_it_is_said_which_input_changed(store, changed, reason):
    identity, *_ = identity_of(STUDY, STUDY.case(0))
    stored(store, identity._replace(**changed))
    assert missing_by_reason(STUDY, store) == {reason: 1, "new": 2}


def test_a_library_that_changed_is_named_with_both_versions(store, tmp_path):
    identity, *_ = identity_of(STUDY, STUDY.case(0))
    stored(store, identity._replace(versions="before"))
    earlier = (tmp_path / "versions.json").read_text().replace('"numpy": "', '"numpy": "0.')
    earlier = earlier.replace(identity.versions, "before")
    now = (tmp_path / "versions.json").read_text()
    (tmp_path / "versions.json").write_text(earlier[:-1].rstrip().rstrip("}") + "}," + now[1:])
    (reason, _), *_ = missing_by_reason(STUDY, store).items()
    assert reason.startswith("changed: numpy 0.")


def test_a_broken_run_is_tried_again(store):
    identity, *_ = identity_of(STUDY, STUDY.case(0))
    stored(store, identity, "broken")
    assert missing_by_reason(STUDY, store) == {"broken: tried again": 1, "new": 2}
    assert Inventory(store).outcome(identity, {}) is None


def test_an_axis_at_the_value_that_the_scenario_has_uses_its_rows(store):
    identity, *_ = identity_of(STUDY, STUDY.case(0))
    stored(store, identity)
    varied = plan_from({"scenario": "unicycles", "vary": {"network.loss": [0.0]}})
    of_axis, *_ = identity_of(varied, varied.case(0))
    assert Inventory(store).outcome(of_axis, {"network.loss": 0.0}) == "safe"


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
