"""phalanx scenarios, report, compare and verify: look at what there is."""

from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.allowed import LARGEST_SEED, require_file, require_other
from phalanx.cli.options import Engine, RunArgument, Trust
from phalanx.cli.terminal import complain, say
from phalanx.launcher.engine import DEFAULT_ENGINE


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(scenarios)
    app.command()(report)
    app.command()(compare)
    app.command()(verify)


def scenarios() -> int:
    """List the scenarios that ship."""
    from rich.console import Console

    from phalanx.cli.text_table import TextTable
    from phalanx.scenario.load import load, shipped

    table = TextTable("name", "agents", "duration", "description")
    for name in shipped():
        scenario = load(name)
        roles = [group.role for _, group, _ in scenario.roster()]
        agents = f"{roles.count('normal')} + {roles.count('adversary')}"
        table.add_row(name, agents, f"{scenario.duration:g} s", scenario.description)
    Console().print(table)
    say("agents: normal + adversary. Run one with: phalanx run NAME")
    return 0


def report(run: RunArgument, trust: Trust = False) -> int:
    """Make the report of a run: one HTML file, and the figures as PNG.

    A recording that was cut short gives a report of what there is. Prints where the report is, and
    how large the recording.
    """
    import phalanx
    from phalanx.cli.damage import warn_of_damage
    from phalanx.cli.display import doing
    from phalanx.recording.read import size_in_words

    try:
        recorded = phalanx.open(run, trust=trust)
        warn_of_damage(recorded.recording)
        with doing("drawing the report") as show:
            written = recorded.report(show)
        say(written)
        say(f"recording: {size_in_words(recorded.recording)}")
    except (phalanx.UnreadableRecordingError, OSError) as error:
        complain(error)
        return 3
    return 0


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN...", help="Folders of runs.")],
    html: Annotated[
        Path | None,
        typer.Option(
            callback=require_file, help="Write the figures of all runs side by side there."
        ),
    ] = None,
    trust: Trust = False,
) -> int:
    """Say how runs differ, in their scenarios and in what they came to.

    Examples:

      phalanx compare runs/unicycles-1 runs/unicycles-2
      phalanx compare runs/unicycles-* --html beside.html
    """
    from rich.console import Console

    from phalanx.cli.text_table import TextTable
    from phalanx.recording.read import UnreadableRecordingError, find
    from phalanx.report.compare import (
        compared_run,
        differences,
        results,
        titles,
        write_comparison,
    )

    if len(runs) < 2:
        raise typer.BadParameter("expected two runs or more")
    try:
        require_other("--html", html, [find(run) for run in runs])
        compared = [compared_run(run, drawn=html is not None, trust=trust) for run in runs]
        table = TextTable("", *titles(compared))
        for row in differences(compared):
            table.add_row(*row)
        table.add_section()
        for row in results(compared):
            table.add_row(*row)
        Console().print(table)
        if html is not None:
            say(write_comparison(compared, html))
    except (UnreadableRecordingError, OSError) as error:
        complain(error)
        return 3
    return 0


def verify(
    run: RunArgument,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=LARGEST_SEED, help="Run again with another seed, to see where it departs."
        ),
    ] = None,
    engine: Engine = DEFAULT_ENGINE,
    trust: Trust = False,
) -> int:
    """Run a recording's scenario again and say whether the trajectory is bit-identical.

    Exit status 0 if it is, 1 if it is not, 3 if the recording cannot be read or run, 130
    if it was stopped.
    """
    import phalanx
    from phalanx.cli.display import progress
    from phalanx.guarantee.verdict import Outcome, exit_status
    from phalanx.launcher.verify import cut_short

    try:
        recorded = phalanx.open(run, trust=trust)
        with progress(recorded.scenario) as show:
            verification = recorded.verify(engine=engine, seed=seed, progress=show)
    except (phalanx.UnreadableRecordingError, phalanx.EngineError, OSError) as error:
        complain(error)
        return 3
    except KeyboardInterrupt:
        complain("stopped")
        return exit_status(Outcome.STOPPED)
    if cut_short(recorded.recording):
        summary = recorded.summary
        why = recorded.recording.damage or (summary and summary.reason) or "no summary"
        say(f"{recorded.recording.path}: {why}; comparing what there is")
    say(verification)
    return 0 if verification else 1
