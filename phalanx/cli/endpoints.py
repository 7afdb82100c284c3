"""Zenoh endpoints on the command line: their syntax, and a check before leaving this host."""

import ipaddress
import re
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from phalanx.extensions.registered import extension
from phalanx.wire.credentials import AUTHORITY, CERTIFICATE, ENDPOINT, PRIVATE_KEY

if TYPE_CHECKING:
    from phalanx.launcher.live import LiveRun

_AT_A_PORT = re.compile(r"(tcp|udp|tls|quic|ws)/(\[[\da-fA-F:.%]+\]|[\w.-]+):(?P<port>\d+)")
_ON_THIS_HOST = "unixsock"
"""The beginning of protocols whose address is a file."""


def require_endpoint(endpoint: str | None) -> str | None:
    """Reject what is not a Zenoh endpoint with a port from 1 to 65535; files are accepted."""
    if endpoint and not endpoint.startswith(_ON_THIS_HOST):
        found = _AT_A_PORT.fullmatch(_without_settings(endpoint))
        if not found or not 1 <= int(found["port"]) <= 65535:
            raise typer.BadParameter(f"expected such as tcp/127.0.0.1:7447, got {endpoint}")
    return endpoint


def require_here(endpoint: str, insecure: bool, expected: str) -> None:
    """Reject an endpoint beyond this host unless --insecure; expected: the options to use."""
    if not insecure and not on_loopback(endpoint):
        raise typer.BadParameter(f"{endpoint} is not for this host alone: expected {expected}")


def live_run(folder: Path, insecure: bool) -> "LiveRun | None":
    """Return the address of the run that is running in this folder, or None."""
    from phalanx.launcher.live import find_live

    found = find_live(folder)
    if found is not None:
        # The file may come from another user.
        require_here(found.endpoint, insecure, "--insecure")
    return found


def identity_for(folder: Path | None, endpoint: str, insecure: bool) -> Path | None:
    """Return the folder of a program's TLS identity; require one for exactly the tls endpoints.

    Without one endpoints beyond this host are rejected, unless --insecure.
    """
    if folder is None:
        require_here(endpoint, insecure, "--keys DIR (see phalanx keys), or --insecure")
    if (folder is not None) != endpoint.startswith(("tls/", "quic/")):
        raise typer.BadParameter(f"--keys: expected with a tls/ endpoint alone, got {endpoint}")
    if folder is not None:
        _require_identity(folder)
    return folder


def _require_identity(folder: Path) -> None:
    for name in (AUTHORITY, CERTIFICATE, PRIVATE_KEY):
        if not (folder / name).is_file():
            raise typer.BadParameter(f"--keys: expected {name} in {folder}; see phalanx keys")
    try:
        extension("require-current")(folder)
    except (ValueError, OSError) as error:
        raise typer.BadParameter(
            f"--keys: {folder}: {error}; make new ones: phalanx keys"
        ) from error


def endpoint_for(connect: str, keys: Path | None) -> str:
    """Return the endpoint of the option, else that in the keys' folder, else this host's."""
    if not connect and keys is not None and (keys / ENDPOINT).is_file():
        return (keys / ENDPOINT).read_text(encoding="utf-8").strip()
    return connect or "tcp/127.0.0.1:7447"


def on_loopback(endpoint: str) -> bool:
    """Return whether a Zenoh endpoint is reachable from its own host alone."""
    if endpoint.startswith(_ON_THIS_HOST):
        return True
    host = _without_settings(endpoint).partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _without_settings(endpoint: str) -> str:
    return re.split("[?#]", endpoint)[0]
