"""phalanx tap: a run's traffic as it goes."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from phalanx.cli.allowed import require_run
from phalanx.cli.endpoints import certificates_for, live_run, require_endpoint
from phalanx.cli.options import Insecure, KeysFolder, Secret
from phalanx.cli.terminal import complain, say

Kind = Literal["sample", "actuation", "broadcast", "telemetry", "frame", "status", "verdict"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(tap)


def tap(
    run: Annotated[
        str, typer.Argument(metavar="RUN", help="The folder of a run that goes on, or its name.")
    ],
    connect: Annotated[
        str,
        typer.Option(
            envvar="PHALANX_CONNECT",
            callback=require_endpoint,
            help="Zenoh endpoint of its hub, where RUN is a name.",
        ),
    ] = "",
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    kind: Annotated[Kind | None, typer.Option(help="Only messages of this kind.")] = None,
    count: Annotated[
        int, typer.Option(min=0, help="End after so many messages; 0: with the run.")
    ] = 0,
) -> int:
    """Print what the programs of a run tell one another, one message a line, until it is over.

    Each line is a JSON array: the key expression, then the message's fields in the order of
    docs/wire.md. Messages are decoded generically, as any program in any language could do it.

    Examples:

      phalanx tap runs/unicycles-1
      phalanx tap r1 --connect tcp/127.0.0.1:7447 --kind broadcast
    """
    from phalanx.wire.membership import Membership
    from phalanx.wire.session import HubError
    from phalanx.wire.tap import tapped

    if connect:
        certificates = certificates_for(keys, connect, insecure)
        membership = Membership(
            require_run(run), connect, secret.encode(), timeout=10.0, certificates=certificates
        )
    else:
        found = live_run(Path(run), insecure)
        if found is None:
            raise typer.BadParameter(f"{run}: no run goes on there; or give its name and --connect")
        membership = found.membership
    try:
        for number, (key, fields) in enumerate(tapped(membership, kind or "*"), start=1):
            say(json.dumps([key, fields], default=repr))
            if number == count:
                break
    except HubError as error:
        complain(error)
        return 3
    return 0
