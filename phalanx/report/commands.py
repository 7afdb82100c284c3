"""phalanx report and animate: figures and moving pictures of a run."""

from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import RunArgument, Trust
from phalanx.launcher.streams import echo


def register(app: typer.Typer) -> None:
    app.command(rich_help_panel=Job.LOOK)(report)
    app.command(rich_help_panel=Job.LOOK)(animate)


def report(
    run: RunArgument,
    trust: Trust = False,
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
        written = recorded.report(show)
    echo(written)
    echo(f"recording: {size_in_words(recorded.recording)}")
    return 0


def animate(
    run: RunArgument,
    picture: Annotated[Path, typer.Argument(help="Ends in .webp or .gif.")],
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
