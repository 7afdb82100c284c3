"""phalanx keys: one certificate for each program of a scenario, for runs on many hosts."""

import datetime
from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.allowed import require_hosts
from phalanx.cli.options import Overrides, ScenarioOption, Trust
from phalanx.cli.terminal import say


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel="Programs of a run")(keys)


def _require_days(days: float) -> float:
    """Refuse certificates that are never valid, or beyond what a date can be."""
    if not 0.0 < days <= 36500.0:
        raise typer.BadParameter(f"expected more than 0 and at most 36500, got {days:g}")
    return days


def keys(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new folder for the certificates.")
    ],
    scenario: ScenarioOption,
    overrides: Overrides = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            callback=require_hosts,
            help="Name or address under which the plant is reached, or a router. Repeatable; the "
            "first, at port 7447, is where programs connect unless they are told otherwise.",
        ),
    ] = None,
    claims: Annotated[
        bool,
        typer.Option(
            "--claims",
            help="Let agents claim free places with DIR/claimant: the plant keeps the authority's "
            "key, to sign for them.",
        ),
    ] = False,
    days: Annotated[
        float, typer.Option(callback=_require_days, help="For how long they are valid.")
    ] = 30.0,
    trust: Trust = False,
) -> int:
    """Make a certificate for each program: links are encrypted, and both ends know each other.

    DIR/NAME is one program's: give each host the folders of its own programs, and no others.

    Example:

      phalanx keys keys --scenario unicycles --host plant.example.org
      phalanx plant --keys keys/plant --listen tls/0.0.0.0:7447 --scenario unicycles --run r1
      phalanx agent 1 --keys keys/1 --scenario unicycles --run r1
      phalanx agent --claim --keys keys/claimant --scenario unicycles --run r1
    """
    from phalanx.identities.authority import make_certificates
    from phalanx.scenario.load import load
    from phalanx.schema.user_code import code_trusted
    from phalanx.wire.keys import CLAIMANT, OPERATOR, PLANT, ROUTER, VIEWER
    from phalanx.wire.membership import ENDPOINT

    with code_trusted(trust):
        programs = load(scenario, overrides or ()).programs()
    names = [PLANT, ROUTER, VIEWER, OPERATOR, *([CLAIMANT] if claims else []), *programs]
    reached_as = ["localhost", "127.0.0.1", *(hosts or ())]
    try:
        make_certificates(folder, names, reached_as, datetime.timedelta(days=days), claims)
        for host in (hosts or ())[:1]:
            at = f"[{host}]" if ":" in host else host  # an IPv6 address
            for name in names:
                (folder / name / ENDPOINT).write_text(f"tls/{at}:7447\n", encoding="utf-8")
    except OSError as error:
        raise typer.BadParameter(f"DIR: {error}") from error
    say(f"{folder}: certificates of {', '.join(names)}")
    return 0
