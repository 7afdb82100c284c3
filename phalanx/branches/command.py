"""phalanx branch: from when on was a violation inevitable?"""

from collections.abc import Sequence
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.option_checks import require_png
from phalanx.cli.options import RunArgument, Trust
from phalanx.launcher.streams import echo

if TYPE_CHECKING:
    from phalanx.branches.inevitable import BranchesAt
    from phalanx.guarantee.verdict import Summary


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(branch)


def branch(
    run: RunArgument,
    at: Annotated[
        list[float] | None,
        typer.Option(
            min=0.0, help="A time at which branches leave the run, in seconds. Repeatable."
        ),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(min=1e-3, help="Or: so often, until the run violates or ends, in seconds."),
    ] = None,
    branches: Annotated[
        int, typer.Option(min=1, max=100_000, help="Number of branches at each time.")
    ] = 50,
    until: Annotated[
        float | None,
        typer.Option(min=0.0, help="End of each branch, in seconds; by default the run's."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, max=1024, help="Processes at the same time.")] = 2,
    picture: Annotated[
        Path | None, typer.Option(callback=require_png, help="Draw the curve there, as PNG.")
    ] = None,
    trust: Trust = False,
) -> int:
    """After a violated run: from when on was the violation inevitable?

    The run goes again up to a time T. From there on all that is random is drawn again: clocks,
    losses, delays, disturbances, lies. The share of these branches that violate says how far the
    violation was decided at T. Each branch is a run of the scenario with one more entry of
    `reseed`. The curve is drawn among the run's figures, and `phalanx report` shows it.

    Examples:

      phalanx branch runs/unicycles-1 --at 1.8 --at 2.2 --branches 50
      phalanx branch runs/unicycles-1 --every 0.2 --until 4 --picture inevitable.png
    """
    from rich.console import Console
    from rich.progress import Progress

    from phalanx.branches.inevitable import branch_run, landmarks
    from phalanx.branches.picture import save_picture
    from phalanx.launcher.streams import warn_of_damage
    from phalanx.recording.read import read
    from phalanx.report.write import INEVITABLE

    recorded = read(run, trust)
    warn_of_damage(recorded)
    ends = [recorded.scenario.duration, *(each.t for each in landmarks(recorded.summary)[:1])]
    if until is not None:
        ends.append(until)
    times = [*(at or ()), *multiples(every, min(ends))]
    if not times:
        raise typer.BadParameter("expected --at, or --every shorter than the run")
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("branching", total=len(set(times)) * branches)
        try:
            curve = branch_run(
                recorded,
                times,
                branches,
                until=until,
                at_once=jobs,
                done=lambda: bar.advance(task),
            )
        except ValueError as error:
            raise typer.BadParameter(f"--at: {error}") from error
    _show(curve, recorded.summary)
    figures = recorded.path.parent / "figures"
    figures.mkdir(exist_ok=True)
    for file in filter(None, (figures / INEVITABLE, picture)):
        save_picture(curve, recorded.summary, file)
        echo(file)
    return 0


def multiples(every: float | None, end: float) -> list[float]:
    """Return the multiples of a time that are before an end [s]."""
    if every is None:
        return []
    times = (round(n * every, 9) for n in count(1))
    return list(takewhile(lambda t: t < end, times))


def _show(curve: "Sequence[BranchesAt]", summary: "Summary | None") -> None:
    from rich.console import Console

    from phalanx.branches.inevitable import from_when, landmarks
    from phalanx.cli.display import TextTable

    table = TextTable("left at", "violated", "probability, 95 %", "worst h_tot: least, largest")
    for each in curve:
        worst = sorted(s.worst_h_tot for s in each.summaries)
        low, high = each.interval
        table.add_row(
            f"{each.t:.3f} s",
            f"{each.violated} of {len(worst)}",
            f"{low:.1%} to {high:.1%}",
            f"{worst[0]:.4g}, {worst[-1]:.4g}",
        )
    Console().print(table)
    known = landmarks(summary)
    for words, share in (("half of the branches violate", 0.5), ("all branches violate", 1.0)):
        t = from_when(curve, share)
        if t is not None:
            before = "".join(f"; {m.t - t:.3f} s before {m.happens}" for m in known)
            echo(f"{words} that leave at {t:.3f} s or later{before}")
