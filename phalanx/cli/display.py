"""Progress bar, tables and key figures of a run in a terminal."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column, Table
from rich.text import Text

from phalanx.guarantee.verdict import Outcome, Summary, certified, timing_rows
from phalanx.launcher.streams import echo_error, printable
from phalanx.messages.kinds import Status
from phalanx.scenario.model import Scenario
from phalanx.theory.rows.origin import origin_label

COLOUR = {
    Outcome.GUARANTEED: "green",
    Outcome.SAFE: "yellow",
    Outcome.VIOLATED: "red",
    Outcome.BROKEN: "red",
    Outcome.STOPPED: "yellow",
}

_MOST_NAMES = 8
"""Most names of agents or pairs in one line."""
_EVERY = 10.0
"""Time from one line of progress to the next [s]."""


class TextTable(Table):
    """A table of plain text without rich's markup; `styled` makes a cell in a style."""

    def __init__(self, *headers: str, **options: Any) -> None:
        super().__init__(*headers, box=None, pad_edge=False, **options)

    def add_column(self, header: Any = "", *others: Any, **options: Any) -> None:
        """Add a column, as rich's table does."""
        super().add_column(_as_text(header), *others, overflow="fold", **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        """Add a row, as rich's table does."""
        super().add_row(*map(_as_text, cells), **options)


def styled(text: str, style: str) -> Text:
    """Return text in a style of rich's."""
    return Text(printable(text), style)


def _as_text(cell: Any) -> Any:
    return styled(cell, "") if isinstance(cell, str) else cell


@contextlib.contextmanager
def progress(scenario: Scenario) -> Iterator[Callable[[Status], None]]:
    """Show a progress bar of 80 columns; yields the function to call with each status."""
    columns = (
        _text("{task.description}", overflow="ellipsis"),
        BarColumn(bar_width=None, table_column=Column(ratio=1, min_width=4)),
        _text("{task.completed:.2f}/{task.total:g} s"),
        _text("{task.fields[factor]}"),
        _text("{task.fields[worst]}"),
        _text("{task.fields[backups]}"),
        TimeRemainingColumn(table_column=Column(no_wrap=True)),
    )
    bar = Progress(*columns, console=Console(stderr=True), transient=True, expand=True)
    agents = sum(group.size for group in scenario.agents)
    task = bar.add_task("starting", total=scenario.duration, factor="", worst="", backups="")

    def show(status: Status) -> None:
        bar.start()
        if status.waiting_for:
            bar.update(task, description=_waiting(status.waiting_for, agents))
            return
        bar.update(
            task,
            description=scenario.name,
            completed=status.t,
            factor=f"{status.real_time_factor:.1f}x",
            worst="" if status.worst_h is None else f"worst h {status.worst_h:.3g}",
            backups=f"backups {status.backups}",
        )

    try:
        yield show
    finally:
        # To stop a bar that was never shown would print an empty line.
        if bar.live.is_started:
            bar.stop()


@contextlib.contextmanager
def progress_of_runs(total: int) -> Iterator[Callable[[str, int, str], None]]:
    """Show runs that are done, by a bar or some lines; yields show(title, their number, words)."""
    count, words = _text("{task.completed:.0f}/{task.total:.0f}"), _text("{task.fields[words]}")
    columns = _text("{task.description}"), BarColumn(), count, words, TimeRemainingColumn()
    console, next_line = Console(stderr=True), 0.0
    bar = Progress(*columns, console=console, transient=True, speed_estimate_period=1e4)
    task = bar.add_task("", total=total, words="")
    moves = console.is_terminal or console.is_jupyter

    def show(title: str, finished: int, words: str) -> None:
        nonlocal next_line
        bar.update(task, description=title, completed=finished, words=words)
        if not moves and time.monotonic() >= next_line:
            console.print(bar)
            next_line = time.monotonic() + _EVERY

    with bar if moves else contextlib.nullcontext():
        yield show


@contextlib.contextmanager
def spinner(activity: str) -> Iterator[Callable[[str], None]]:
    """Show an activity while the block runs; yields the function to call with each part of it.

    Without a terminal parts are lines, at most one a second.
    """
    console, due = Console(stderr=True), 0.0

    def show(part: str) -> None:
        nonlocal due
        status.update(styled(f"{activity}: {part}", ""))
        if not console.is_terminal and time.monotonic() >= due:
            due = time.monotonic() + 1.0
            echo_error(f"{activity}: {part}")

    with console.status(styled(activity, "")) as status:
        yield show


def _text(words: str, **options: Any) -> TextColumn:
    return TextColumn(words, markup=False, table_column=Column(no_wrap=True, **options))


def _waiting(missing: Sequence[str], agents: int) -> str:
    """Describe how many agents have joined, and which have not."""
    names = ", ".join(missing[:_MOST_NAMES]) + (", ..." if len(missing) > _MOST_NAMES else "")
    return f"{agents - len(missing)} of {agents} agents have joined, waiting for {names}"


def last_line(summary: Summary) -> str:
    """Return the verdict and its reason, and the unsafe pairs of a run that ended early."""
    words = "; lost: ".join([f"{summary.outcome}: {summary.reason}", *summary.lost])
    if summary.outcome is Outcome.VIOLATED or not summary.violations:
        return words
    pairs = ", ".join(violation.pair for violation in summary.violations[:_MOST_NAMES])
    more = ", ..." if len(summary.violations) > _MOST_NAMES else ""
    return f"{words}; until then these left the safe set: {pairs}{more}"


def print_summary(summary: Summary, details: Mapping[str, str] = MappingProxyType({})) -> None:
    """Print the table of a run's key figures, and others by name."""
    table = TextTable(show_header=False)
    table.add_column(style="dim")
    table.add_column()
    table.add_row("verdict", styled(summary.outcome, f"{COLOUR[summary.outcome]} bold"))
    table.add_row("virtual time", f"{summary.t:.3f} s, seed {summary.seed}")
    factor = f"real-time factor {summary.real_time_factor:.1f}"
    table.add_row("wall time", f"{summary.wall_time:.2f} s, {factor}")
    table.add_row("worst h", f"{summary.worst_in_words}; safe is at most 0")
    for name, words in details.items():
        if words:
            table.add_row(name, words)
    table.add_row("control steps", _steps(summary))
    table.add_row("certified", certified(summary))
    for assumption in summary.assumptions:
        table.add_row(assumption.name, _assumption(assumption.failed, assumption.checked))
    for needed in summary.theorem:
        if needed.name not in {a.name for a in summary.assumptions}:
            counts = _assumption(needed.failed, needed.checked)
            table.add_row(f"of the theorem: {needed.name}", counts)
    for violation in summary.violations:
        depth = f"h up to {violation.worst:.4g} at t = {violation.worst_at:.3f} s"
        text = f"{violation.pair}: {depth}, {violation.times}"
        table.add_row(styled("violated", "red"), text)
    for violation in summary.excluded:
        text = f"{violation.pair}: h up to {violation.worst:.4g}, {violation.times}"
        table.add_row("turned, not counted", text)
    for reason, count in summary.rejected.items():
        table.add_row("payloads dropped", f"{count} {reason}")
    for member in summary.lost:
        table.add_row("lost", member)
    for fault in summary.faults:
        times = "once" if fault.count == 1 else f"{fault.count} times"
        hit = styled(times, "") if fault.count else styled("never had an effect", "yellow")
        table.add_row(f"fault: {fault.name}", hit)
    table.add_row("trajectory", summary.trajectory[:16])
    if summary.punctuality:
        for name, value in timing_rows(summary.punctuality):
            table.add_row(f"real time: {name}", value)
    Console().print(table)


def _steps(summary: Summary) -> str:
    total = sum(summary.origins.values())
    shares = [
        f"{origin_label(name)} {count / total:.1%}"
        for name, count in summary.origins.items()
        if total
    ]
    return f"{summary.steps}; of normal agents: {', '.join(shares)}"


def _assumption(failed: int, checked: int) -> Text:
    if not failed:
        return styled("held", "green")
    return styled(f"failed {failed} of {checked}", "yellow")
