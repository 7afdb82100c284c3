"""phalanx plant and agent: a single program of a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli import option_checks as checks
from phalanx.cli import options

if TYPE_CHECKING:
    from phalanx.messages.membership import Membership
    from phalanx.scenario.model import Scenario


def plant(
    scenario: options.ScenarioOption,
    run: options.RunId,
    listen: options.Listen = "tcp/127.0.0.1:7447",
    connect: Annotated[
        str | None,
        typer.Option(
            envvar="PHALANX_ROUTER",
            callback=checks.require_endpoint,
            help="Zenoh endpoint of a router to meet the agents at, in place of --listen.",
        ),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            envvar="PHALANX_FOLDER",
            callback=checks.require_folder,
            help="The run's folder, for recording and summary; made if it is not there.",
        ),
    ] = Path("."),
    seed: options.Seed = None,
    overrides: options.Overrides = None,
    secret: options.Secret = "",
    keys: options.KeysFolder = None,
    insecure: options.Insecure = False,
    command_secret: options.CommandSecret = "",
    speed: options.Speed = None,
    real_time: options.RealTimeFactor = None,
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
    identity = checks.identity_for(keys, endpoint, insecure)
    membership = Membership(run, endpoint, secret.encode(), PLANT, identity_folder=identity)
    options = {
        "folder": folder,
        "policy": policy,
        "at_router": connect is not None,
        "real_time": real_time,
    }
    loaded = load(scenario, overrides or (), seed)
    checks.require_here(getattr(loaded.fresh_world(), "router", None), insecure, "--insecure")
    if (folder / RECORDING).exists():
        raise typer.BadParameter(f"--folder: expected one without a recording, got {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    return _run_here(loaded, membership, options)


def agent(
    scenario: options.ScenarioOption,
    run: options.RunId,
    name: Annotated[
        str, typer.Argument(help="The name of the agent to run.", show_default=False)
    ] = "",
    connect: options.Connect = "",
    timeout: options.Timeout = 60.0,
    seed: options.Seed = None,
    overrides: options.Overrides = None,
    secret: options.Secret = "",
    keys: options.KeysFolder = None,
    insecure: options.Insecure = False,
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
    endpoint = checks.endpoint_for(connect, keys)
    identity = checks.identity_for(keys, endpoint, insecure)
    membership = Membership(run, endpoint, secret.encode(), name, timeout, identity)
    return _run_here(resolved, membership, {})


def _run_here(scenario: "Scenario", membership: "Membership", options: dict[str, Any]) -> int:
    from phalanx.launcher.programs import configure_logging, run_program
    from phalanx.swarm.rows import build_rows
    from phalanx.swarm.swarm import build_swarm

    configure_logging()
    return run_program(build_rows(build_swarm(scenario)), membership, options)
