"""Tasks of any executor: handed out, tried again if their worker dies, and their rows taken."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import NamedTuple

from phalanx.launcher import interrupt
from phalanx.studies.row import BROKEN, Row
from phalanx.studies.work import Job

MOST_ATTEMPTS = 3
"""Attempts at a run whose worker dies."""


class Task(NamedTuple):
    """Runs that are computed together."""

    work: Callable[[Job], list[Row]]
    """Returns the row of each run."""
    job: Job
    take: tuple[Callable[[Row], None], ...]
    """Of each run, what takes its row, also if the run is given up."""
    attempts: int = MOST_ATTEMPTS
    """Most of them."""
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
        """Tasks to hand out before others: repetitions."""
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
                with interrupt.NotDeferred():
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
            if attempt < task.attempts:
                alone = job._replace(identities=(identity,))
                self.first.append(Task(task.work, alone, (take,), task.attempts, attempt + 1))
            else:
                overrides = job.overrides
                take(Row(identity=identity, overrides=overrides, outcome=BROKEN, reason=words))
