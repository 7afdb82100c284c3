"""phalanx plant, agent and tap: a single program of a run, and the messages between them."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from phalanx.cli.option_checks import (
    endpoint_for,
    identity_for,
    live_run,
    require_endpoint,
    require_folder,
    require_here,
    require_run,
)
from phalanx.cli.options import (
    CommandSecret,
    Connect,
    Insecure,
    KeysFolder,
    Listen,
    Overrides,
    RealTimeFactor,
    RunId,
    ScenarioOption,
    Secret,
    Seed,
    Speed,
    Timeout,
)
from phalanx.launcher.streams import echo

if TYPE_CHECKING:
    from phalanx.messages.membership import Membership
    from phalanx.scenario.model import Scenario

Kind = Literal["sample", "actuation", "broadcast", "telemetry", "frame", "status", "verdict"]


def plant(
    scenario: ScenarioOption,
    run: RunId,
    listen: Listen = "tcp/127.0.0.1:7447",
    connect: Annotated[
        str | None,
        typer.Option(
            envvar="PHALANX_ROUTER",
            callback=require_endpoint,
            help="Zenoh endpoint of a router to meet the agents at, in place of --listen.",
        ),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            envvar="PHALANX_FOLDER",
            callback=require_folder,
            help="The run's folder, for recording and summary; made if it is not there.",
        ),
    ] = Path("."),
    seed: Seed = None,
    overrides: Overrides = None,
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    command_secret: CommandSecret = "",
    speed: Speed = None,
    real_time: RealTimeFactor = None,
) -> int:
    """Run the plant alone: the world, the clock, the hub and the verdict.

    It waits for the scenario's agents, which may run on any host that can reach its endpoint:

      phalanx plant --scenario unicycles --run r1 --keys keys/plant --listen tls/0.0.0.0:7447
    """
    from phalanx.faults.commands import CommandPolicy
    from phalanx.messages.keys import PLANT
    from phalanx.messages.membership import Membership
    from phalanx.recording.records import RECORDING
    from phalanx.scenario.load import load

    policy = CommandPolicy(secret=command_secret.encode(), speed=speed or 0.0)
    endpoint = connect or listen
    identity = identity_for(keys, endpoint, insecure)
    membership = Membership(run, endpoint, secret.encode(), PLANT, identity_folder=identity)
    options = {
        "folder": folder,
        "policy": policy,
        "at_router": connect is not None,
        "real_time": real_time,
    }
    loaded = load(scenario, overrides or (), seed)
    require_here(getattr(loaded.fresh_world(), "router", None), insecure, "--insecure")
    if (folder / RECORDING).exists():
        raise typer.BadParameter(f"--folder: expected one without a recording, got {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    return _run_here(loaded, membership, options)


def agent(
    scenario: ScenarioOption,
    run: RunId,
    name: Annotated[
        str, typer.Argument(help="The name of the agent to run.", show_default=False)
    ] = "",
    connect: Connect = "",
    timeout: Timeout = 60.0,
    seed: Seed = None,
    overrides: Overrides = None,
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
) -> int:
    """Run one agent alone, normal or adversary by the scenario.

    Scenario, seed and overrides must be the plant's; it rejects an agent whose scenario differs.
    Under centralised control one process, named controller, decides for all normal agents.

      phalanx agent 4 --scenario unicycles --run r1 --connect tcp/127.0.0.1:7447
    """
    from phalanx.messages.membership import Membership
    from phalanx.scenario.load import load

    resolved = load(scenario, overrides or (), seed)
    names = resolved.programs()
    if name not in names:
        expected = f"expected one of {', '.join(names)}"
        raise typer.BadParameter(f"agent: {expected}, got {name or 'no name'}")
    endpoint = endpoint_for(connect, keys)
    identity = identity_for(keys, endpoint, insecure)
    membership = Membership(run, endpoint, secret.encode(), name, timeout, identity)
    return _run_here(resolved, membership, {})


def _run_here(scenario: "Scenario", membership: "Membership", options: dict[str, Any]) -> int:
    from phalanx.launcher.programs import configure_logging, run_program
    from phalanx.swarm.rows import build_rows
    from phalanx.swarm.swarm import build_swarm

    configure_logging()
    return run_program(build_rows(build_swarm(scenario)), membership, options)


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
    from phalanx.messages.membership import Membership
    from phalanx.wire.tap import tapped

    if connect:
        identity = identity_for(keys, connect, insecure)
        membership = Membership(
            require_run(run), connect, secret.encode(), timeout=10.0, identity_folder=identity
        )
    else:
        live = live_run(Path(run), insecure)
        if live is None:
            raise typer.BadParameter(f"{run}: no live run; or give its name and --connect")
        membership = live
    for number, (key, fields) in enumerate(tapped(membership, kind or "*"), start=1):
        echo(json.dumps([key, fields], default=repr))
        if number == count:
            break
    return 0
