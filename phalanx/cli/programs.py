"""phalanx plant, phalanx agent: one program of a run, by itself, for containers and many hosts."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.options import Overrides, RunId, ScenarioOption, Secret, Seed

Endpoint = Annotated[
    str,
    typer.Option(
        "--connect", envvar="PHALANX_CONNECT", help="Zenoh endpoint of the plant or a router."
    ),
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(rich_help_panel="Programs of a run")(plant)
    app.command(rich_help_panel="Programs of a run")(agent)


def plant(
    scenario: ScenarioOption,
    run: RunId,
    listen: Annotated[
        str, typer.Option(envvar="PHALANX_LISTEN", help="Zenoh endpoint to listen on.")
    ] = "tcp/127.0.0.1:7447",
    out: Annotated[
        Path, typer.Option(envvar="PHALANX_OUT", help="Folder for the recording and the summary.")
    ] = Path("."),
    seed: Seed = None,
    overrides: Overrides = None,
    secret: Secret = "",
    control: Annotated[
        str,
        typer.Option(
            envvar="PHALANX_CONTROL",
            metavar="SECRET",
            help="Who has it may command the run; without one nobody may.",
            show_default=False,
        ),
    ] = "",
    speed: Annotated[
        float,
        typer.Option(
            min=0.0, help="Seconds of virtual time per second, at most; 0: as fast as it goes."
        ),
    ] = 0.0,
) -> int:
    """Run the plant alone: the world, the clock, the hub and the verdict.

    It waits for the scenario's agents, which may run anywhere that reaches its endpoint:

      phalanx plant --scenario unicycles --run r1 --listen tcp/0.0.0.0:7447
    """
    from phalanx.faults.commands import CommandPolicy

    options = {
        "run_id": run, "endpoint": listen, "secret": secret.encode(), "folder": out,
        "policy": CommandPolicy(secret=control.encode(), speed=speed),
    }  # fmt: skip
    return _run_here("plant", scenario, overrides, seed, options)


def agent(
    name: Annotated[str, typer.Argument(help="Which of the scenario's agents to be.")],
    scenario: ScenarioOption,
    run: RunId,
    connect: Endpoint = "tcp/127.0.0.1:7447",
    timeout: Annotated[float, typer.Option(help="How long to try to reach the hub [s].")] = 60.0,
    seed: Seed = None,
    overrides: Overrides = None,
    secret: Secret = "",
) -> int:
    """Run one agent alone, normal or adversary as the scenario says.

    Scenario, seed and overrides must be the plant's; it refuses an agent whose scenario differs.
    Under centralised control one process, named controller, decides for all normal agents.

      phalanx agent 4 --scenario unicycles --run r1 --connect tcp/plant:7447
    """
    options = {
        "name": name, "run_id": run, "endpoint": connect, "secret": secret.encode(),
        "timeout": timeout,
    }  # fmt: skip
    return _run_here("agent", scenario, overrides, seed, options)


def _run_here(
    program: str,
    source: str,
    overrides: list[str] | None,
    seed: int | None,
    options: dict[str, object],
) -> int:
    from phalanx.launcher.programs import configure_logging, run_program
    from phalanx.scenario.load import load
    from phalanx.wire.session import HubError

    scenario = load(source, overrides or (), seed)
    names = scenario.programs()
    if "name" in options and options["name"] not in names:
        expected = ", ".join(names)
        raise typer.BadParameter(f"agent: expected one of {expected}, got {options['name']!r}")
    configure_logging()
    try:
        return run_program(program, scenario, options)
    except (HubError, OSError) as error:
        print(error, file=sys.stderr)
        return 3
