"""phalanx report and compare: figures of one run, and runs side by side."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from phalanx.cli.option_checks import require_file, require_other
from phalanx.cli.options import RunArgument, Trust
from phalanx.launcher.streams import echo


def register(app: typer.Typer) -> None:
    app.command()(report)
    app.command()(compare)
    app.command()(animate)


def report(
    run: RunArgument,
    trust: Trust = False,
    style: Annotated[
        Literal["screen", "paper"],
        typer.Option(help="paper: figures as wide as a paper's column, also as PDF."),
    ] = "screen",
) -> int:
    """Make the report of a run: one HTML file, and the figures as PNG.

    A recording that was cut short gives a report of what it holds. Prints the report's path and
    the size of the recording.
    """
    import phalanx
    from phalanx.cli.display import spinner
    from phalanx.launcher.streams import warn_of_damage
    from phalanx.recording.read import size_in_words

    recorded = phalanx.open(run, trust=trust)
    warn_of_damage(recorded.recording)
    with spinner("drawing the report") as show:
        written = recorded.report(show, style=style)
    echo(written)
    echo(f"recording: {size_in_words(recorded.recording)}")
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
    """List the differences of runs, in their scenarios and in their results.

    Examples:

      phalanx compare runs/unicycles-1 runs/unicycles-2
      phalanx compare runs/unicycles-* --html compared.html
    """
    from rich.console import Console

    from phalanx.cli.display import TextTable
    from phalanx.recording.read import find
    from phalanx.report.compare import compared_run, differences, results, titles, write_comparison

    if len(runs) < 2:
        raise typer.BadParameter("expected two runs or more")
    require_other("--html", html, [find(run) for run in runs])
    compared = [compared_run(run, draw=html is not None, trust=trust) for run in runs]
    table = TextTable("", *titles(compared))
    for row in differences(compared):
        table.add_row(*row)
    table.add_section()
    for row in results(compared):
        table.add_row(*row)
    Console().print(table)
    if html is not None:
        echo(write_comparison(compared, html))
    return 0


def animate(
    run: RunArgument,
    picture: Annotated[Path, typer.Argument(help="Ends in .webp, .gif or .mp4.")],
    speed: Annotated[float, typer.Option(help="Virtual seconds in a second.")] = 1.0,
    trust: Trust = False,
) -> int:
    """Write a run as a moving picture.

    Example:

      phalanx animate runs/unicycles-1 unicycles.webp --speed 2
    """
    import phalanx

    recorded = phalanx.open(run, trust=trust)
    try:
        echo(recorded.animate(picture, speed=speed))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    return 0
