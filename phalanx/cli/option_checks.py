"""Checks of command-line options: a wrong value is rejected before anything is created."""

import ipaddress
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from phalanx.messages import credentials

if TYPE_CHECKING:
    from phalanx.messages.membership import Membership

_LONGEST_WAIT = 1e6
"""[s]; Zenoh counts in milliseconds."""
_SECRETS = {"--secret": credentials.SECRET, "--command-secret": credentials.COMMAND_SECRET}
"""Options that do not exist, by the variables to use in their place."""
_AT_A_PORT = re.compile(r"(tcp|udp|tls|quic|ws)/(\[[\da-fA-F:.%]+\]|[\w.-]+):(?P<port>\d+)")
_ON_THIS_HOST = "unixsock"
"""The beginning of protocols of Zenoh whose address is a file."""


def require_values(arguments: Sequence[str]) -> None:
    """Reject an empty argument, which is most often an unset shell variable."""
    for before, argument in zip(["", *arguments], arguments, strict=False):
        if not argument or re.fullmatch("--[a-z-]+=", argument):
            option = argument or (before if before.startswith("--") else "an argument")
            raise typer.BadParameter(f"{option.rstrip('=')}: expected a value, got an empty text")


def require_run(run: str) -> str:
    """Reject a run's name that is not one chunk of a key expression; empty is allowed."""
    if run and not re.fullmatch(r"[A-Za-z0-9][\w.-]*", run):
        raise typer.BadParameter(f"expected letters, digits, '.', '_' and '-', got {run!r}")
    return run


def require_number(expected: str, holds: Callable[[float], bool]) -> Callable[[Any], Any]:
    """Make a callback that rejects numbers for which `holds` is false; expected: in words."""

    def check(number: Any) -> Any:
        if number is not None and not holds(number):
            raise typer.BadParameter(f"expected {expected}, got {number}")
        return number

    return check


require_port = require_number("1 to 65535", lambda port: 1 <= port <= 65535)
require_timeout = require_number(
    f"0 to {_LONGEST_WAIT:.0f} s", lambda wait: 0.0 <= wait <= _LONGEST_WAIT
)
require_speed = require_number(
    "a finite number, or 0: as fast as it goes", lambda speed: 0.0 <= speed < float("inf")
)


def require_file(path: Path | None) -> Path | None:
    """Reject a folder, and a file in a folder that does not exist."""
    if path is not None and (path.is_dir() or not path.parent.is_dir()):
        raise typer.BadParameter(f"expected a file in a folder that exists, got {path}")
    return path


def require_other(option: str, path: Path | None, recordings: Sequence[Path]) -> None:
    """Reject an output file that is one of the recordings that are read."""
    if path is not None and path.exists() and any(map(path.samefile, recordings)):
        raise typer.BadParameter(f"{option}: expected another file than the recording, got {path}")


def require_folder(path: Path | None) -> Path | None:
    """Reject a folder that cannot be made because it, or one of its parents, is a file."""
    if path is not None:
        nearest = next(p for p in (path, *path.absolute().parents) if p.exists())
        if not nearest.is_dir():
            raise typer.BadParameter(f"expected a folder, got {path}: {nearest} is a file")
    return path


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def refuse_secrets(arguments: Sequence[str]) -> None:
    """Reject a secret among the arguments: every user of this host can read those."""
    for option in (argument.partition("=")[0] for argument in arguments):
        if option in _SECRETS:
            raise typer.BadParameter(
                f"{option}: every user of this host can read a program's arguments: make a new "
                f"secret, and give it in the environment, {_SECRETS[option]}, or in a file, "
                f"{option}-file"
            )


def secret_from(variable: str) -> Callable[[str], str]:
    """Make a callback that reads the secret from the option's file, else from the variable."""

    def read(file: str) -> str:
        if not file:
            return os.environ.get(variable, "")
        try:
            secret = Path(file).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise typer.BadParameter(f"cannot be read: {error}") from error
        if not secret:
            raise typer.BadParameter(f"expected a secret in {file}, got nothing")
        return secret

    return read


def require_endpoint(endpoint: str | None) -> str | None:
    """Reject what is not a Zenoh endpoint with a port from 1 to 65535; files are accepted."""
    if endpoint and not endpoint.startswith(_ON_THIS_HOST):
        match = _AT_A_PORT.fullmatch(_without_settings(endpoint))
        if not match or not 1 <= int(match["port"]) <= 65535:
            raise typer.BadParameter(f"expected such as tcp/127.0.0.1:7447, got {endpoint}")
    return endpoint


def require_here(endpoint: str | None, insecure: bool, expected: str) -> None:
    """Reject an endpoint beyond this host unless --insecure; expected: the options to use."""
    if endpoint is not None and not insecure and not on_loopback(endpoint):
        raise typer.BadParameter(f"{endpoint} is not for this host alone: expected {expected}")


def live_run(folder: Path, insecure: bool) -> "Membership | None":
    """Return a viewer's membership of the run that is running in this folder, or None."""
    from phalanx.launcher.live import find_live

    membership = find_live(folder)
    if membership is not None:
        # The file may come from another user.
        require_here(membership.endpoint, insecure, "--insecure")
    return membership


def identity_for(folder: Path | None, endpoint: str, insecure: bool) -> Path | None:
    """Return the folder of a program's TLS identity; require one for exactly the tls endpoints.

    Without one endpoints beyond this host are rejected, unless --insecure.
    """
    if folder is None:
        require_here(endpoint, insecure, "--keys DIR (see phalanx keys), or --insecure")
    if (folder is not None) != endpoint.startswith(("tls/", "quic/")):
        raise typer.BadParameter(f"--keys: expected with a tls/ endpoint alone, got {endpoint}")
    if folder is None:
        return None
    for name in (credentials.AUTHORITY, credentials.CERTIFICATE, credentials.PRIVATE_KEY):
        if not (folder / name).is_file():
            raise typer.BadParameter(f"--keys: expected {name} in {folder}; see phalanx keys")
    return folder


def endpoint_for(connect: str, keys: Path | None) -> str:
    """Return the endpoint of the option, else that in the keys' folder, else this host's."""
    if not connect and keys is not None and (keys / credentials.ENDPOINT).is_file():
        return (keys / credentials.ENDPOINT).read_text(encoding="utf-8").strip()
    return connect or "tcp/127.0.0.1:7447"


def on_loopback(endpoint: str) -> bool:
    """Return whether a Zenoh endpoint is reachable from its own host alone."""
    if endpoint.startswith(_ON_THIS_HOST):
        return True
    host = _without_settings(endpoint).partition("/")[2].rpartition(":")[0].strip("[]")
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


def _without_settings(endpoint: str) -> str:
    return re.split("[?#]", endpoint)[0]
