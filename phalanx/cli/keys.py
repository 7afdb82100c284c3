"""phalanx keys: one certificate for each program of a scenario, for runs on many hosts."""

import datetime
from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.options import Overrides, ScenarioOption


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel="Programs of a run")(keys)


def keys(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new folder for the certificates.")
    ],
    scenario: ScenarioOption,
    overrides: Overrides = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host", help="Name or address under which the plant is reached. Repeatable."
        ),
    ] = None,
    days: Annotated[float, typer.Option(help="For how long they are valid.")] = 30.0,
) -> int:
    """Make a certificate for each program: links are encrypted, and both ends know each other.

    DIR/NAME is one program's: give each host the folders of its own programs, and no others.

    Example:

      phalanx keys keys --scenario unicycles --host plant.example.org
      phalanx plant --keys keys/plant --listen tls/0.0.0.0:7447 --scenario unicycles --run r1
      phalanx agent 1 --keys keys/1 --connect tls/plant.example.org:7447 ...
    """
    from phalanx.scenario.load import load
    from phalanx.wire.authority import make_certificates
    from phalanx.wire.keys import OPERATOR, PLANT, ROUTER, VIEWER

    names = [PLANT, ROUTER, VIEWER, OPERATOR, *load(scenario, overrides or ()).programs()]
    reached_as = ["localhost", "127.0.0.1", *(hosts or ())]
    try:
        make_certificates(folder, names, reached_as, datetime.timedelta(days=days))
    except OSError as error:
        raise typer.BadParameter(f"DIR: {error}") from error
    print(f"{folder}: certificates of {', '.join(names)}")
    return 0
