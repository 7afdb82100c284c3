"""Where a run's certificates are, and how Zenoh is told of them."""

from pathlib import Path
from typing import Any, Literal

AUTHORITY = "ca"
"""The name of who signed them all; no program's."""


def certificate_file(folder: Path, name: str) -> Path:
    """Where a program's certificate is, or the authority's."""
    return folder / f"{name}.crt"


def key_file(folder: Path, name: str) -> Path:
    """Where a program's private key is."""
    return folder / f"{name}.key"


def tls(folder: Path, name: str, role: Literal["listen", "connect"]) -> dict[str, Any]:
    """Zenoh's `tls` of one program: both ends show a certificate of the run's authority."""
    return {
        "enable_mtls": True,
        "root_ca_certificate": str(certificate_file(folder, AUTHORITY)),
        f"{role}_certificate": str(certificate_file(folder, name)),
        f"{role}_private_key": str(key_file(folder, name)),
        "close_link_on_expiration": True,
    }
