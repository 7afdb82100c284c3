"""The progress of a study as a bar with the remaining time, in a terminal or a notebook."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from phalanx.studies.coordinator import Progress, StudyProgress
from phalanx.studies.plan import Plan


@contextmanager
def shown(plan: Plan) -> Iterator[Progress]:
    """Show a bar while the block runs; yields the function to call with the progress."""
    outcomes = TextColumn("{task.fields[outcomes]}", markup=False)
    columns = BarColumn(), MofNCompleteColumn(), outcomes, TimeRemainingColumn()
    name = TextColumn("{task.description}", markup=False)
    bar = Bar(name, *columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(plan.name, total=plan.size, outcomes="")

    def show(progress: StudyProgress) -> None:
        counts = ", ".join(f"{n} {outcome}" for outcome, n in progress.outcomes.most_common())
        bar.update(task, completed=progress.done, outcomes=counts)

    with bar:
        yield show
