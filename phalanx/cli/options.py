"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from phalanx.wire.certificates import AUTHORITY, CERTIFICATE, PRIVATE_KEY

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

KeysFolder = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        envvar="PHALANX_KEYS",
        metavar="DIR",
        help="This program's folder of those that `phalanx keys` makes; the endpoint is then "
        "tls/HOST:PORT.",
        show_default=False,
    ),
]


Trust = Annotated[
    bool,
    typer.Option(
        "--trust", help="Import and so run the modules that its scenario names, if it names any."
    ),
]


def certificates_for(folder: Path | None, endpoint: str) -> Path | None:
    """The folder, if it has a program's certificate and the endpoint asks for one."""
    if (folder is not None) != endpoint.startswith(("tls/", "quic/")):
        raise typer.BadParameter(f"--keys: expected with a tls/ endpoint alone, got {endpoint}")
    if folder is not None:
        for name in (AUTHORITY, CERTIFICATE, PRIVATE_KEY):
            if not (folder / name).is_file():
                raise typer.BadParameter(f"--keys: expected {name} in {folder}; see phalanx keys")
    return folder


def require_port(port: int | None) -> int | None:
    """Refuse a number that no TCP port has."""
    if port is not None and not 1 <= port <= 65535:
        raise typer.BadParameter(f"expected 1 to 65535, got {port}")
    return port
