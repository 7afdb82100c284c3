"""Zenoh sessions: one is the hub, the plant's own or a router's; all others are its clients."""

import contextlib
import os
import resource
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
import zenoh

from phalanx.compat.zenoh_linger import close_at_once
from phalanx.wire.credentials import Admission, Credentials, tls
from phalanx.wire.keys import COPIES, NOT_URGENT
from phalanx.wire.liveliness import is_announced
from phalanx.wire.messages import MAX_BYTES

# Three threads instead of seven in a client, and a third less latency. Never in the hub: what
# forwards would deadlock on its own back-pressure.
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
    beyond: Sequence[str] = (),
    credentials: Credentials | None = None,
) -> zenoh.Session:
    """Open the session that all programs of a run meet in. Raises HubError.

    Without an admission everybody may come in and do everything. Where the run has other hubs,
    beyond has the endpoints of those to connect to, and credentials what is shown there; a hub that
    is not there yet, or is lost, is tried again for as long as this one lives.

    This process may open as many files from then on as its hard limit allows: each connection takes
    some, and the usual soft limit of 1024 is too low for a few hundred programs.
    """
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    config = _hub_config(endpoint, beyond)
    with contextlib.ExitStack() as stack:
        if credentials is not None:
            _show(config, credentials)
        if admission is not None:
            _admit(config, admission, stack)
        # Whoever started this process may have been a client, and left it in the environment.
        if os.environ.get(_RUNTIME) == _CLIENT_RUNTIME:
            del os.environ[_RUNTIME]
        try:
            session = zenoh.open(_parsed(config))
        except zenoh.ZError as error:
            raise HubError(f"cannot listen on {endpoint}: {_reason(error)}") from error
    close_at_once(session)
    return session


def _hub_config(endpoint: str, beyond: Sequence[str]) -> dict[str, Any]:
    config: dict[str, Any] = {
        **_common(),
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "connect": {"endpoints": list(beyond), "retry": _RETRY},
    }
    # Half-open connections must not keep agents out.
    config["transport"]["unicast"] = {
        "accept_pending": 1000,
        "accept_timeout": 1000,
        "max_sessions": 10_000,
    }
    # Samples go before all else: what an agent floods a peer with must not stand before them.
    behind = {"flows": ["ingress"], "messages": ["put"], "overwrite": {"priority": "data"}}
    # Nor may who looks on and takes nothing hold up who shows or answers it something, or fill the
    # queue of the lowest priority, through which the hub's goodbye goes: it would never end.
    shown = {"congestion_control": "drop", "priority": "data_low"}
    onlookers = {"flows": ["ingress"], "overwrite": shown}
    config["qos"] = {
        "network": [
            {**behind, "key_exprs": list(NOT_URGENT)},
            {**onlookers, "messages": ["put"], "key_exprs": [COPIES]},
            {**onlookers, "messages": ["query"], "key_exprs": ["**"]},
        ]
    }
    return config


def _admit(
    config: dict[str, Any], admission: Admission, while_opening: contextlib.ExitStack
) -> None:
    config["access_control"] = dict(admission.access_control)
    if admission.certificates is not None:
        own = config["transport"]["link"].setdefault("tls", {})
        own |= tls(admission.certificates, "listen")
        return
    passwords = while_opening.enter_context(_file_in_memory(admission.passwords))
    auth = config["transport"].setdefault("auth", {}).setdefault("usrpwd", {})
    auth["dictionary_file"] = passwords


@contextlib.contextmanager
def _file_in_memory(passwords: Mapping[str, str]) -> Iterator[str]:
    """The path of a file that nobody else can open: Zenoh takes passwords from nowhere else."""
    with os.fdopen(os.memfd_create("phalanx"), "w") as file:
        file.writelines(f"{name}:{password}\n" for name, password in passwords.items())
        file.flush()
        yield f"/proc/self/fd/{file.fileno()}"


def open_client(
    endpoint: str, timeout: float, credentials: Credentials | None = None
) -> zenoh.Session:
    """Join the hub, trying for `timeout` seconds. Raises HubError."""
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
    # What a callback puts is sent when it is over, since one thread does both. Until then the queue
    # has to hold all of it: the most that there may be, allocated when it is needed.
    config["transport"]["link"]["tx"] = {"queue": {"size": {"data": _MOST_BATCHES}}}
    if credentials is not None:
        _show(config, credentials)
    try:
        return zenoh.open(_parsed(config))
    except zenoh.ZError as error:
        # Who is refused is not told so: there is nothing to tell it from a hub that is not there.
        proof = "certificate" if credentials and credentials.certificates else "secret"
        cause = f"{_reason(error)}; is the {proof} the run's?" if credentials else _reason(error)
        raise HubError(f"no hub at {endpoint} within {timeout:.3g} s: {cause}") from error


def _parsed(config: dict[str, Any]) -> zenoh.Config:
    return zenoh.Config.from_json5(msgspec.json.encode(config).decode())


def _show(config: dict[str, Any], credentials: Credentials) -> None:
    shown = credentials.to_connect()
    config["transport"]["link"] |= shown.pop("link", {})
    config["transport"] |= shown


def open_member(
    endpoint: str, token: str, timeout: float, credentials: Credentials | None = None
) -> zenoh.Session:
    """Join the hub as open_client does, and return when it has announced itself on `token`.

    A client that comes in while the hub is still being opened may be let in and never be told of
    anything. The hub announces itself last, so whoever does not see that tries once more.
    """
    deadline, patience = time.monotonic() + timeout, 3.0
    while (left := deadline - time.monotonic()) > 0:
        session = open_client(endpoint, left, credentials)
        if is_announced(session, token, min(patience, left)):
            return session
        session.close()  # type: ignore[no-untyped-call]
        patience *= 2.0
    raise HubError(f"nobody is there as {token} at {endpoint} after {timeout:g} s")


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
                # What is in the kernel's buffers cannot be overtaken.
                "tcp": {"so_sndbuf": _SOCKET_BYTES, "so_rcvbuf": _SOCKET_BYTES},
            },
        },
    }


def _reason(error: Exception) -> str:
    # Zenoh appends source places; a user needs the cause only.
    return str(error).split(" at /")[0].rstrip(".")


def free_endpoint() -> str:
    """A TCP endpoint on loopback that is free now."""
    with reserved_endpoint() as endpoint:
        return endpoint


@contextlib.contextmanager
def reserved_endpoint() -> Iterator[str]:
    """A TCP endpoint on loopback that nobody else is given while the block runs."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        # Bound without it, so that the kernel gives the port to nobody who asks for any; with it
        # from now on, so that a hub, which asks for this one, may listen beside a socket that
        # does not.
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield f"tcp/127.0.0.1:{holder.getsockname()[1]}"
