"""The certificate of one program: three files in a folder, and how Zenoh is told of them.

Their names are those of a Kubernetes TLS secret, which can be mounted as it is.
"""

from pathlib import Path
from typing import Any, Literal

AUTHORITY, CERTIFICATE, PRIVATE_KEY = "ca.crt", "tls.crt", "tls.key"
AUTHORITY_KEY = "ca.key"
"""Beside them in the plant's folder, where agents may claim places."""
ENDPOINT = "endpoint"
"""Beside them where the hub's host was known: where to connect to."""


def tls(folder: Path, role: Literal["listen", "connect"]) -> dict[str, Any]:
    """Zenoh's `tls` of one program: both ends show a certificate of the run's authority.

    Who connects goes on only if the hub's is good for the host that it connected to.
    """
    return {
        "enable_mtls": True,
        "root_ca_certificate": str(folder / AUTHORITY),
        f"{role}_certificate": str(folder / CERTIFICATE),
        f"{role}_private_key": str(folder / PRIVATE_KEY),
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
