"""Zenoh sessions: a hub in the plant or in a router, and its clients."""

import contextlib
import os
import resource
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
import zenoh

from phalanx.messages.credentials import Admission, Credentials, tls
from phalanx.messages.keys import NOT_URGENT
from phalanx.messages.kinds import MAX_BYTES
from phalanx.wire.liveliness import is_announced
from phalanx.wire.zenoh_sessions import disable_linger

# A client with three threads in place of seven has a third less latency. The hub cannot have
# this: forwarding would deadlock on its own back-pressure.
_RUNTIME = "ZENOH_RUNTIME"
"""Zenoh reads it when a process opens its first session."""
_CLIENT_RUNTIME = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), "
    "app: (worker_threads: 1))"
)

_MOST_BATCHES = 16
_SOCKET_BYTES = 128 * 1024
_RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}

Session = zenoh.Session


class HubError(RuntimeError):
    """The hub cannot listen, or cannot be reached; the message names the endpoint."""


def open_hub(
    endpoint: str,
    admission: Admission | None = None,
    other_hubs: Sequence[str] = (),
    credentials: Credentials | None = None,
) -> zenoh.Session:
    """Open the session that all programs of a run connect to. Raises HubError.

    The soft limit of open files is raised to the hard limit: each connection takes some, and the
    usual 1024 are too few for a few hundred programs.

    Args:
        endpoint: where to listen.
        admission: the programs and their permissions; without it there are no restrictions.
        other_hubs: endpoints of hubs to connect to, tried again as long as the session lives.
        credentials: for those hubs.
    """
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    config = _hub_config(endpoint, other_hubs)
    with contextlib.ExitStack() as stack:
        if credentials is not None:
            _add_credentials(config, credentials)
        if admission is not None:
            _add_admission(config, admission, stack)
        # It may be inherited from a parent process that is a client.
        if os.environ.get(_RUNTIME) == _CLIENT_RUNTIME:
            del os.environ[_RUNTIME]
        try:
            session = zenoh.open(_parsed(config))
        except zenoh.ZError as error:
            raise HubError(f"cannot listen on {endpoint}: {_reason(error)}") from error
    disable_linger(session)
    return session


def _hub_config(endpoint: str, other_hubs: Sequence[str]) -> dict[str, Any]:
    config: dict[str, Any] = {
        **_common(),
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "connect": {"endpoints": list(other_hubs), "retry": _RETRY},
    }
    # Many half-open connections must not block those of agents.
    config["transport"]["unicast"] = {
        "accept_pending": 1000,
        "accept_timeout": 1000,
        "max_sessions": 10_000,
    }
    # Samples have priority over all else: an agent's flood must not delay them.
    not_urgent = {"flows": ["ingress"], "messages": ["put"], "overwrite": {"priority": "data"}}
    # Queries of viewers must not fill the queue of the lowest priority, through which the hub
    # closes its sessions: it would never end.
    dropped = {"congestion_control": "drop", "priority": "data_low"}
    asked = {"flows": ["ingress"], "messages": ["query"], "overwrite": dropped}
    config["qos"] = {
        "network": [
            {**not_urgent, "key_exprs": list(NOT_URGENT)},
            {**asked, "key_exprs": ["**"]},
        ]
    }
    return config


def _add_admission(
    config: dict[str, Any], admission: Admission, while_opening: contextlib.ExitStack
) -> None:
    config["access_control"] = dict(admission.access_control)
    if admission.identity_folder is not None:
        tls_settings = config["transport"]["link"].setdefault("tls", {})
        tls_settings |= tls(admission.identity_folder, "listen")
        return
    passwords = while_opening.enter_context(_file_in_memory(admission.passwords))
    auth = config["transport"].setdefault("auth", {}).setdefault("usrpwd", {})
    auth["dictionary_file"] = passwords


@contextlib.contextmanager
def _file_in_memory(passwords: Mapping[str, str]) -> Iterator[str]:
    """Write a file that no other process can open, and yield its path: Zenoh needs a file."""
    with os.fdopen(os.memfd_create("phalanx"), "w") as file:
        file.writelines(f"{name}:{password}\n" for name, password in passwords.items())
        file.flush()
        yield f"/proc/self/fd/{file.fileno()}"


def open_client(
    endpoint: str, timeout: float, credentials: Credentials | None = None
) -> zenoh.Session:
    """Connect to the hub, trying for `timeout` seconds. Raises HubError."""
    os.environ.setdefault(_RUNTIME, _CLIENT_RUNTIME)
    config = {
        **_common(),
        "mode": "client",
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": int(timeout * 1000),
            "retry": _RETRY,
        },
    }
    # Messages put in a callback are sent after it, by the same thread: the queue must hold them
    # all. Its batches are allocated when needed.
    config["transport"]["link"]["tx"] = {"queue": {"size": {"data": _MOST_BATCHES}}}
    if credentials is not None:
        _add_credentials(config, credentials)
    try:
        return zenoh.open(_parsed(config))
    except zenoh.ZError as error:
        # A hub that rejects the credentials cannot be distinguished from a missing one.
        proof = "identity" if credentials and credentials.identity_folder else "secret"
        cause = f"{_reason(error)}; is the {proof} the run's?" if credentials else _reason(error)
        raise HubError(f"no hub at {endpoint} within {timeout:.3g} s: {cause}") from error


def _parsed(config: dict[str, Any]) -> zenoh.Config:
    return zenoh.Config.from_json5(msgspec.json.encode(config).decode())


def _add_credentials(config: dict[str, Any], credentials: Credentials) -> None:
    transport = credentials.to_connect()
    config["transport"]["link"] |= transport.pop("link", {})
    config["transport"] |= transport


def open_member(
    endpoint: str, token: str, timeout: float, credentials: Credentials | None = None
) -> zenoh.Session:
    """Connect as open_client does, and return when the hub's liveliness token is there.

    A client that connects while the hub is being opened may never receive anything. The hub
    declares its token last, so a client that does not see it connects again.
    """
    deadline, patience = time.monotonic() + timeout, 3.0
    while (remaining := deadline - time.monotonic()) > 0:
        session = open_client(endpoint, remaining, credentials)
        if is_announced(session, token, min(patience, remaining)):
            return session
        session.close()  # type: ignore[no-untyped-call]
        patience *= 2.0
    raise HubError(f"no program has announced {token} at {endpoint} after {timeout:g} s")


def _common() -> dict[str, Any]:
    return {
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
            "delay": 0,
        },
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {
                "rx": {"max_message_size": 4 * MAX_BYTES},
                # Messages in the kernel's buffers cannot be overtaken by urgent ones.
                "tcp": {"so_sndbuf": _SOCKET_BYTES, "so_rcvbuf": _SOCKET_BYTES},
            },
        },
    }


def _reason(error: Exception) -> str:
    # Zenoh appends source locations.
    return str(error).split(" at /")[0].rstrip(".")


def free_endpoint() -> str:
    """Return a TCP endpoint on loopback that is free now."""
    with reserved_endpoint() as endpoint:
        return endpoint


@contextlib.contextmanager
def reserved_endpoint() -> Iterator[str]:
    """Reserve a TCP endpoint on loopback for the time of the block."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        # Bound without SO_REUSEADDR, so that the kernel gives the port to no other socket; set
        # afterwards, so that the hub, which sets it too, may bind the same port.
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield f"tcp/127.0.0.1:{holder.getsockname()[1]}"
