"""phalanx keys and router: TLS identities for the programs of a run, and a separate hub."""

import datetime
import ipaddress
import logging
import re
import signal
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.option_checks import identity_for, require_endpoint, require_number
from phalanx.cli.options import (
    Insecure,
    KeysFolder,
    Listen,
    Overrides,
    RunId,
    ScenarioOption,
    Secret,
    Seed,
    Trust,
)
from phalanx.launcher.streams import echo

log = logging.getLogger("phalanx.router")

_LABEL = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(rich_help_panel=Job.DEPLOY)(keys)
    app.command(rich_help_panel=Job.DEPLOY)(router)


def _require_endpoints(endpoints: list[str] | None) -> list[str] | None:
    """Reject a list with a text that is not an endpoint."""
    for endpoint in endpoints or ():
        require_endpoint(endpoint)
    return endpoints


def _require_hosts(hosts: list[str] | None) -> list[str] | None:
    """Reject texts that are neither a host's name nor an IP address."""
    for host in hosts or ():
        if not all(map(_LABEL.fullmatch, host.split("."))):
            try:
                ipaddress.ip_address(host)
            except ValueError as error:
                expected = "expected a host's name or address, such as plant.example.org"
                raise typer.BadParameter(f"{expected}, got {host!r}") from error
    return hosts


def keys(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder for the identities.")],
    scenario: ScenarioOption,
    overrides: Overrides = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            callback=_require_hosts,
            help="Name or address of the plant's or a router's host. Repeatable; programs connect "
            "to the first, at port 7447, unless --connect names another.",
        ),
    ] = None,
    days: Annotated[
        float,
        typer.Option(
            callback=require_number(
                "more than 0 and at most 36500", lambda days: 0.0 < days <= 36500.0
            ),
            help="Days until they expire.",
        ),
    ] = 30.0,
    trust: Trust = False,
) -> int:
    """Make a TLS identity for each program, so that links are encrypted and authenticated.

    DIR/NAME is one program's: give each host the folders of its own programs, and no others.

    Example:

      phalanx keys keys --scenario unicycles --host plant.example.org
      phalanx plant --keys keys/plant --listen tls/0.0.0.0:7447 --scenario unicycles --run r1
      phalanx agent 1 --keys keys/1 --scenario unicycles --run r1
    """
    from phalanx.messages.credentials import ENDPOINT
    from phalanx.messages.keys import OPERATOR, PLANT, ROUTER, VIEWER
    from phalanx.scenario.load import load
    from phalanx_hosts.authority import make_identities

    programs = load(scenario, overrides or (), trust=trust).programs()
    names = [PLANT, ROUTER, VIEWER, OPERATOR, *programs]
    hub_hosts = ["localhost", "127.0.0.1", *(hosts or ())]
    try:
        make_identities(folder, names, hub_hosts, datetime.timedelta(days=days))
        for host in (hosts or ())[:1]:
            at = f"[{host}]" if ":" in host else host  # an IPv6 address
            for name in names:
                (folder / name / ENDPOINT).write_text(f"tls/{at}:7447\n", encoding="utf-8")
    except OSError as error:
        raise typer.BadParameter(f"DIR: {error}") from error
    echo(f"{folder}: identities of {', '.join(names)}")
    return 0


def router(
    scenario: ScenarioOption,
    run: RunId,
    listen: Listen = "tcp/127.0.0.1:7447",
    connect: Annotated[
        list[str] | None,
        typer.Option(
            envvar="PHALANX_ROUTER",
            callback=_require_endpoints,
            help="Zenoh endpoint of another router of the run, or of its plant. Repeatable.",
        ),
    ] = None,
    seed: Seed = None,
    overrides: Overrides = None,
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    trust: Trust = False,
) -> int:
    """Run a hub alone, for a plant that is started with --connect; press Ctrl-C to end it.

    It may be restarted in the middle of a run in real time. A run may have several routers that
    connect to one another, each near some of the agents; each forwards messages to the others.

      phalanx router --scenario unicycles --run r1 --keys keys/router --listen tls/0.0.0.0:7447
      phalanx router --scenario unicycles --run r1 --connect tls/router.example.org:7447
    """
    from phalanx.launcher.programs import configure_logging
    from phalanx.messages.admission import admission
    from phalanx.messages.keys import ROUTER
    from phalanx.messages.membership import Membership
    from phalanx.scenario.load import load
    from phalanx.swarm.swarm import build_swarm
    from phalanx.wire import liveliness
    from phalanx.wire.session import open_hub

    for endpoint in (listen, *(connect or ())):
        identity_folder = identity_for(keys, endpoint, insecure)
    membership = Membership(run, listen, secret.encode(), ROUTER, identity_folder=identity_folder)
    configure_logging()
    swarm = build_swarm(load(scenario, overrides or (), seed, trust=trust))
    # No threading.Event: a signal handler that sets one while this thread enters wait() deadlocks.
    stop_signal: SimpleQueue[int] = SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: stop_signal.put(number))
    credentials = membership.credentials if connect else None
    allowed = admission(swarm, membership)
    with open_hub(listen, allowed, connect or (), credentials) as session:
        # Clients that have seen this token wait for the hub to come back after it was lost.
        _token = liveliness.announce(
            session, membership.keys.alive(ROUTER, str(session.info.zid()))
        )
        log.info("run %s meets at %s", run, listen)
        stop_signal.get()
    return 0
