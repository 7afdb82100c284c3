"""Options that several commands share."""

import ipaddress
import re
from pathlib import Path
from typing import Annotated

import typer

from phalanx.wire.certificates import AUTHORITY, CERTIFICATE, ENDPOINT, PRIVATE_KEY

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


def require_run(run: str) -> str:
    """A run's name, one chunk of a key expression; or none. Raises BadParameter."""
    if run and not re.fullmatch(r"[A-Za-z0-9][\w.-]*", run):
        raise typer.BadParameter(f"expected letters, digits, '.', '_' and '-', got {run!r}")
    return run


RunId = Annotated[
    str,
    typer.Option(
        "--run",
        envvar="PHALANX_RUN",
        callback=require_run,
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


Insecure = Annotated[
    bool,
    typer.Option(
        "--insecure",
        envvar="PHALANX_INSECURE",
        help="Leave this host without --keys: whoever is on the network reads the run.",
    ),
]


NOT_HERE = "{} is not for this host alone: expected"


def certificates_for(folder: Path | None, endpoint: str, insecure: bool) -> Path | None:
    """The folder, if it has a program's certificate and the endpoint asks for one.

    Without one nothing leaves this host, unless that is asked for.
    """
    if folder is None and not insecure and not on_loopback(endpoint):
        expected = "--keys DIR (see phalanx keys), or --insecure"
        raise typer.BadParameter(f"{NOT_HERE.format(endpoint)} {expected}")
    if (folder is not None) != endpoint.startswith(("tls/", "quic/")):
        raise typer.BadParameter(f"--keys: expected with a tls/ endpoint alone, got {endpoint}")
    if folder is not None:
        for name in (AUTHORITY, CERTIFICATE, PRIVATE_KEY):
            if not (folder / name).is_file():
                raise typer.BadParameter(f"--keys: expected {name} in {folder}; see phalanx keys")
    return folder


def endpoint_for(connect: str, keys: Path | None) -> str:
    """Where to connect: as the option or the environment says, or the keys' folder; or here."""
    if not connect and keys is not None and (keys / ENDPOINT).is_file():
        return (keys / ENDPOINT).read_text(encoding="utf-8").strip()
    return connect or "tcp/127.0.0.1:7447"


def on_loopback(endpoint: str) -> bool:
    """Whether a Zenoh endpoint is reached from its own host alone."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unixsock"):
        return True
    host = re.split("[?#]", address)[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def require_port(port: int | None) -> int | None:
    """Refuse a number that no TCP port has."""
    if port is not None and not 1 <= port <= 65535:
        raise typer.BadParameter(f"expected 1 to 65535, got {port}")
    return port


def require_folder(path: Path | None) -> Path | None:
    """Refuse a file in a folder that there is not."""
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(f"expected a file in a folder that exists, got {path}")
    return path


def require_endpoint(endpoint: str | None) -> str | None:
    """Refuse what names a port that there is not; of a socket's file there is none."""
    if endpoint is not None and not endpoint.startswith("unixsock"):
        port = re.split("[?#]", endpoint)[0].rpartition(":")[2]
        if not port.isdecimal() or int(port) > 65535:
            raise typer.BadParameter(f"expected such as tcp/127.0.0.1:7447, got {endpoint}")
    return endpoint
