"""Options that several commands share."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli import option_checks as checks
from phalanx.launcher.engine import ENGINES, FASTEST, require_engine
from phalanx.messages.credentials import COMMAND_SECRET, SECRET

_REAL_TIME = "--real-time"


def _known_engine(engine: str) -> str:
    try:
        require_engine(engine)
    except ValueError as error:
        raise typer.BadParameter(str(error).removeprefix("engine: ")) from error
    return engine


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
RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="The folder of a run, or its recording.mcap.")
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
        callback=checks.require_run,
        help="Name of the run: part of every key expression, the same for all its programs.",
    ),
]
Secret = Annotated[
    str,
    typer.Option(
        "--secret-file",
        envvar="PHALANX_SECRET_FILE",
        metavar="FILE",
        callback=checks.secret_from(SECRET),
        help="File with the secret that the run's programs share, which seals their messages. "
        "Default: PHALANX_SECRET, and in `run` a random one.",
        show_default=False,
    ),
]
CommandSecret = Annotated[
    str,
    typer.Option(
        "--command-secret-file",
        envvar="PHALANX_COMMAND_SECRET_FILE",
        metavar="FILE",
        callback=checks.secret_from(COMMAND_SECRET),
        help="File with the command secret, which allows a viewer to pause the run, kill agents "
        "and so on. Default: PHALANX_COMMAND_SECRET; without one commands are off.",
        show_default=False,
    ),
]
KeysFolder = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        envvar="PHALANX_KEYS",
        metavar="DIR",
        help="This program's folder, made by `phalanx keys`; the endpoint is then tls/HOST:PORT.",
        show_default=False,
    ),
]
Connect = Annotated[
    str,
    typer.Option(
        "--connect",
        envvar="PHALANX_CONNECT",
        callback=checks.require_endpoint,
        help="Zenoh endpoint of the run's hub; by default that in the file `endpoint` in --keys, "
        "or tcp/127.0.0.1:7447.",
        show_default=False,
    ),
]
Listen = Annotated[
    str,
    typer.Option(
        envvar="PHALANX_LISTEN",
        callback=checks.require_endpoint,
        help="Zenoh endpoint to listen on.",
    ),
]
Insecure = Annotated[
    bool,
    typer.Option(
        "--insecure",
        envvar="PHALANX_INSECURE",
        help="Communicate beyond this host without --keys: others on the network can read the run.",
    ),
]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust", help="Run what the scenario names: Python modules, agents' own programs."
    ),
]
Engine = Annotated[
    str,
    typer.Option(
        metavar=f"[{'|'.join(ENGINES)}]",
        callback=_known_engine,
        help=" ".join(f"{name}: {engine.description}." for name, engine in ENGINES.items()),
    ),
]
Timeout = Annotated[
    float,
    typer.Option(
        callback=checks.require_timeout, help="How long to try to reach the hub, in seconds."
    ),
]
Speed = Annotated[
    float | None,
    typer.Option(
        callback=checks.require_speed,
        help="At most this many seconds of virtual time per second; 0: as fast as it goes. By "
        "default 0, or 1 where the run is shown on a page.",
    ),
]
RealTimeFactor = Annotated[
    float | None,
    typer.Option(
        _REAL_TIME,
        envvar="PHALANX_REAL_TIME",
        metavar="[FACTOR]",
        callback=checks.require_number(
            f"more than 0 and at most {FASTEST:g}", lambda factor: 0.0 < factor <= FASTEST
        ),
        help="Run by the wall clock, without waiting for agents: seconds of virtual time per "
        "second; 1 if the factor is left out.",
        show_default=False,
    ),
]


def with_factor(arguments: Sequence[str]) -> list[str]:
    """Insert a 1 after every --real-time without a number: typer has no optional values."""
    completed: list[str] = []
    for argument, following in zip(arguments, [*arguments[1:], ""], strict=True):
        completed.append(argument)
        if argument == _REAL_TIME and not _is_number(following):
            completed.append("1")
    return completed


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
