"""The work of a study: jobs, which any process or machine can compute, and their execution.

A job holds all that it needs, so that it can travel.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, NamedTuple

from phalanx.launcher import interrupt
from phalanx.native.loop.fastest import finish
from phalanx.recording.modules import ModulesError, hashes, make_importable
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx_studies.row import BROKEN, REFUSED, Identity, Row, row_of

MOST_ATTEMPTS = 3
"""Attempts at a run whose worker dies."""


class Job(NamedTuple):
    """Runs of one point of the grid."""

    table: dict[str, Any]
    """The scenario's, before overrides."""
    overrides: dict[str, Any]
    """By path."""
    identities: tuple[Identity, ...]
    """Of the runs."""
    modules: Mapping[str, bytes] = {}
    """Sources of the user's modules, by path."""


_ONE_AT_A_TIME = threading.Lock()
"""Runs of a process share compiled functions and their memory, also those of an executor's threads.
"""


Work = Callable[[Job, Identity, SafetyRows], Row]
"""Makes the row of a run from its compiled rows."""


def _row_by(work: Work, job: Job, identity: Identity) -> Row:
    """Return the row that a work makes; without a run, one that says why."""
    began = time.monotonic()
    try:
        with _ONE_AT_A_TIME:
            make_importable(job.modules, hashes(job.modules), trust=True)
            return work(job, identity, shared_rows(load(job.table, job.overrides, identity.seed)))
    except (ScenarioError, ModulesError) as error:
        outcome, reason = REFUSED, str(error)
    except MistakenMethodError as error:
        outcome, reason = BROKEN, str(error)
    wall = time.monotonic() - began
    return Row(
        identity=identity, overrides=job.overrides, outcome=outcome, reason=reason, wall_time=wall
    )


def _measured(job: Job, identity: Identity, rows: SafetyRows) -> Row:
    run = finish(rows)
    return row_of(identity, job.overrides, run.summary, run.track, rows.swarm, run.engine)


def compute(job: Job, work: Work = _measured) -> list[Row]:
    """Run every run of a job to its verdict, without files; return their rows."""
    return [_row_by(work, job, identity) for identity in job.identities]


class Task(NamedTuple):
    """Runs that are computed together."""

    work: Callable[[Job], list[Row]]
    """Returns the row of each run."""
    job: Job
    take: tuple[Callable[[Row], None], ...]
    """Of each run, what takes its row, also if the run is given up."""
    attempt: int = 1


class Executing:
    """Executes tasks."""

    def __init__(
        self, executor: Executor, in_flight: float, report: Callable[[], object] = lambda: None
    ) -> None:
        """Prepare.

        Args:
            executor: of the tasks.
            in_flight: most tasks that are handed out at a time.
            report: called before each wait, and at the end.
        """
        self.first: deque[Task] = deque()
        """Tasks to hand out before others: those of runs that are tried again."""
        self._executor, self._in_flight, self._report = executor, in_flight, report

    def run(self, tasks: Iterator[Task]) -> None:
        """Execute tasks; a Ctrl-C that is deferred ends it at the next wait."""
        pending: dict[Future[list[Row]], Task] = {}
        try:
            while True:
                while len(pending) < self._in_flight:
                    task = self.first.popleft() if self.first else next(tasks, None)
                    if task is None:
                        break
                    pending[self._executor.submit(task.work, task.job)] = task
                self._report()
                if not pending:
                    return
                with interrupt.interruptible():
                    finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in [future for future in pending if future in finished]:
                    self._take(future, pending.pop(future))
        finally:
            for future in pending:
                future.cancel()

    def _take(self, future: "Future[list[Row]]", task: Task) -> None:
        try:
            rows = future.result()
        except Exception as error:  # of the executor: its worker died
            self._take_failure(task, f"{type(error).__name__}: {error}")
            return
        for take, row in zip(task.take, rows, strict=True):
            take(row)

    def _take_failure(self, task: Task, reason: str) -> None:
        """Try the runs of a task again, each alone; after the last attempt give them up."""
        job, attempt = task.job, task.attempt
        words = f"tried {attempt} times: {reason}" if attempt > 1 else reason
        for take, identity in zip(task.take, job.identities, strict=True):
            if attempt < MOST_ATTEMPTS:
                alone = job._replace(identities=(identity,))
                self.first.append(Task(task.work, alone, (take,), attempt + 1))
            else:
                overrides = job.overrides
                take(Row(identity=identity, overrides=overrides, outcome=BROKEN, reason=words))
