"""phalanx tap: print the messages of a live run."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from phalanx.cli.endpoints import identity_for, live_run
from phalanx.cli.option_checks import require_run
from phalanx.cli.options import Connect, Insecure, KeysFolder, Secret
from phalanx.launcher.streams import echo

Kind = Literal["sample", "actuation", "broadcast", "telemetry", "frame", "status", "verdict"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(tap)


def tap(
    run: Annotated[
        str,
        typer.Argument(metavar="RUN", help="The folder of a live run; with --connect its name."),
    ],
    connect: Connect = "",
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    kind: Annotated[Kind | None, typer.Option(help="Only messages of this kind.")] = None,
    count: Annotated[
        int, typer.Option(min=0, help="End after this many messages; 0: with the run.")
    ] = 0,
) -> int:
    """Print the messages between the programs of a live run, one a line, until it is over.

    Each line is a JSON array: the key expression, then the message's fields in the order of
    docs/wire.md. Messages are decoded without their types, as a program in any language can.

    Examples:

      phalanx tap runs/unicycles-1
      phalanx tap r1 --connect tcp/127.0.0.1:7447 --kind broadcast
    """
    from phalanx.wire.membership import Membership
    from phalanx.wire.tap import tapped

    if connect:
        own = identity_for(keys, connect, insecure)
        membership = Membership(
            require_run(run), connect, secret.encode(), timeout=10.0, identity_folder=own
        )
    else:
        found = live_run(Path(run), insecure)
        if found is None:
            raise typer.BadParameter(f"{run}: no live run; or give its name and --connect")
        membership = found.membership
    for number, (key, fields) in enumerate(tapped(membership, kind or "*"), start=1):
        echo(json.dumps([key, fields], default=repr))
        if number == count:
            break
    return 0
