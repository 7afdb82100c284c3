"""phalanx check: what a scenario guarantees, before any run."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.allowed import require_png
from phalanx.cli.options import Overrides, ScenarioArgument, Seed, Trust
from phalanx.cli.terminal import say
from phalanx.extensions.registered import extension
from phalanx.launcher.streams import printable

if TYPE_CHECKING:
    from phalanx.guarantee.check_report import CheckReport
    from phalanx.scenario.model import Scenario


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(check)


def check(
    scenario: ScenarioArgument,
    seed: Seed = None,
    overrides: Overrides = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            callback=require_png,
            help="Save a picture of where the backup still suffices (PNG).",
        ),
    ] = None,
    strict: Annotated[
        bool, typer.Option(help="Exit with 1 if no run of it could end guaranteed.")
    ] = False,
    trust: Trust = False,
) -> int:
    """Say what a scenario guarantees and what it does not, and what to change.

    Examples:

      phalanx check unicycles
      phalanx check unicycles --set safety.margin=local --set safety.eta=0
      phalanx check unicycles --set network.loss=0.3 --set safety.information=split
      phalanx check guaranteed --plot backup.png
    """
    import phalanx
    from phalanx.schema.user_code import code_trusted

    with code_trusted(trust):
        resolved = phalanx.load(scenario, overrides or (), seed)
    report = phalanx.check(resolved)
    _show(resolved, report)
    if plot is not None:
        if extension("backup-picture")(resolved, plot):
            say(f"picture: {plot}")
        else:
            say("no picture: it needs two agents with states x and y; this scenario has others")
    return 1 if strict and not report.may_be_guaranteed else 0


def _show(scenario: "Scenario", report: "CheckReport") -> None:
    from rich.console import Console

    from phalanx.cli.check_table import asked
    from phalanx.cli.display import TextTable, styled

    say(f"{scenario.name}: {report.answer}")
    table = TextTable("what is asked", "found", "allowed", "paper")
    for row in asked(scenario, report):
        found = styled(row.found, "" if row.holds else "yellow")
        table.add_row(row.what, found, row.allowed, row.equation)
    console = Console()
    console.print(table)
    for words in report.words:
        say(*_wrapped(printable(words), console.width))


def _wrapped(words: str, width: int) -> list[str]:
    """A line of a list, in lines of the terminal."""
    return textwrap.wrap(
        f"- {words}", width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
