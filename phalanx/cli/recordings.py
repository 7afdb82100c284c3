"""phalanx scenarios, report and verify: look at what there is."""

import sys
from pathlib import Path
from typing import Annotated

import typer

RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="The folder of a run, or its recording.mcap.")
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(scenarios)
    app.command()(report)
    app.command()(verify)


def scenarios() -> int:
    """List the scenarios that ship."""
    from rich.console import Console
    from rich.table import Table

    from phalanx.scenario.load import load, shipped

    table = Table(box=None, pad_edge=False)
    for column in ("name", "agents", "duration", "description"):
        table.add_column(column)
    for name in shipped():
        scenario = load(name)
        roles = [group.role for _, group, _ in scenario.roster()]
        agents = f"{roles.count('normal')} + {roles.count('adversary')}"
        table.add_row(name, agents, f"{scenario.duration:g} s", scenario.description)
    Console().print(table)
    print("agents: normal + adversary. Run one with: phalanx run NAME")
    return 0


def report(run: RunArgument) -> int:
    """Make the report of a run: one HTML file, and the figures as PNG.

    A recording that was cut short gives a report of what there is.
    """
    from phalanx.recording.read import UnreadableRecordingError
    from phalanx.report.write import write_report

    try:
        print(write_report(run))
    except (UnreadableRecordingError, OSError) as error:
        print(error, file=sys.stderr)
        return 3
    return 0


def verify(
    run: RunArgument,
    seed: Annotated[
        int | None, typer.Option(help="Run again with another seed, to see where it departs.")
    ] = None,
) -> int:
    """Run a recording's scenario again and say whether the trajectory is bit-identical.

    Exit status 0 if it is, 1 if it is not, 3 if the recording cannot be read or run.
    """
    from phalanx.cli.display import progress
    from phalanx.faults.commands import CommandPolicy
    from phalanx.launcher.launch import LaunchError
    from phalanx.launcher.verify import as_far_as, cut_short, first_difference, run_again
    from phalanx.recording.read import UnreadableRecordingError, read

    try:
        recorded = read(run)
        scenario = as_far_as(recorded).model_copy(update={} if seed is None else {"seed": seed})
        with progress(scenario) as show:
            again = run_again(scenario, show, CommandPolicy(schedule=tuple(recorded.commands)))
    except (UnreadableRecordingError, LaunchError, OSError) as error:
        print(error, file=sys.stderr)
        return 3
    if cut_short(recorded):
        why = recorded.damage or (recorded.summary and recorded.summary.reason) or "no summary"
        print(f"{recorded.path}: {why}; comparing what there is")
    if difference := first_difference(recorded, again):
        print(f"differs: {difference}")
        return 1
    print(f"bit-identical: {len(recorded.steps)} steps and {len(recorded.states)} states")
    return 0
