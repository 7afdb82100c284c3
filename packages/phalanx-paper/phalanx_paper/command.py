"""phalanx reproduce: the paper's figures from runs of this program."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import Overrides, Seed
from phalanx.launcher.streams import echo


def register(app: typer.Typer) -> None:
    app.command(rich_help_panel=Job.STUDY)(reproduce)


def reproduce(
    what: Annotated[Literal["paper"], typer.Argument(help="What to reproduce.")],
    out: Annotated[Path, typer.Option(help="Folder of the page and its runs.")] = Path("paper"),
    overrides: Overrides = None,
    seed: Seed = None,
) -> int:
    """Run both simulations of the paper, and draw its eight figures, numbered as there.

    Writes paper.html, with both η, the verdicts, and what the paper says of each figure. Takes a
    minute or two. --set and --seed change all runs. Exit status: 0 if what the paper says of every
    figure came true, else 1.

    Example:

      phalanx reproduce paper
    """
    from phalanx.cli.display import spinner
    from phalanx.scenario.load import field_and_value
    from phalanx_paper.page import claims, write
    from phalanx_paper.runs import finish

    with spinner("running") as show:
        runs = dict(finish(out / "runs", dict(map(field_and_value, overrides or ())), seed, show))
        show("drawing")
        page = write(out / "paper.html", runs)
    compared = claims(runs)
    for paper, words, holds in compared:
        echo(f"figure {paper.number}: {words}{'' if holds else ': not as the paper says'}")
    echo(page)
    return 0 if all(holds for _, _, holds in compared) else 1
