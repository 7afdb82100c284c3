"""Options that several commands share."""

from typing import Annotated

import typer

ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A TOML file, or the name of a scenario that ships (see phalanx scenarios).",
    ),
]
ScenarioOption = Annotated[
    str,
    typer.Option(
        "--scenario",
        envvar="PHALANX_SCENARIO",
        help="A TOML file, or the name of a scenario that ships.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Set a field, for example network.loss=0.3 or agents.0.clock.period=0.02. Repeatable.",
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(envvar="PHALANX_SEED", help="Replaces the scenario's seed."),
]
RunId = Annotated[
    str,
    typer.Option(
        "--run",
        envvar="PHALANX_RUN",
        help="Name of the run: part of every key expression, the same for all its programs.",
    ),
]
Secret = Annotated[
    str,
    typer.Option(
        envvar="PHALANX_SECRET",
        help="Shared by the run's programs; seals their messages against forgery. "
        "`run` draws one unless it is given.",
        show_default=False,
    ),
]


def require_port(port: int | None) -> int | None:
    """Refuse a number that no TCP port has."""
    if port is not None and not 1 <= port <= 65535:
        raise typer.BadParameter(f"expected 1 to 65535, got {port}")
    return port
