"""Zenoh sessions: one is the hub, the plant's own or a router's; all others are its clients."""

import contextlib
import json
import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from phalanx.wire.certificates import tls
from phalanx.wire.keys import NOT_URGENT
from phalanx.wire.linger import close_at_once
from phalanx.wire.messages import MAX_BYTES

# Three threads instead of seven in a client, and a third less latency. Never in the hub: what
# forwards would deadlock on its own back-pressure.
_RUNTIME = "ZENOH_RUNTIME"
"""Zenoh reads it when a process opens its first session."""
_CLIENT_RUNTIME = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), "
    "app: (worker_threads: 1))"
)

_SOCKET_BYTES = 128 * 1024
_RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}
_GLANCE = 0.2
"""How often a wait looks up to see whether it is over [s]."""

Deliver = Callable[[str, bytes], None]
Publisher = zenoh.Publisher
Session = zenoh.Session


class HubError(RuntimeError):
    """The hub cannot listen, or cannot be reached; the message names the endpoint."""


@dataclass(frozen=True)
class Credentials:
    """How a program shows the hub who it is."""

    name: str
    password: str = field(repr=False)
    """Never sent: it proves itself by its answer to what the hub asks."""
    certificates: Path | None = None
    """The folder of its own certificate, which takes the password's place."""

    def to_connect(self) -> dict[str, Any]:
        """A client's part of Zenoh's `transport`."""
        if self.certificates is None:
            return {"auth": {"usrpwd": {"user": self.name, "password": self.password}}}
        return {"link": {"tls": tls(self.certificates, "connect")}}


@dataclass(frozen=True)
class Admission:
    """Whom a hub lets in, and what each may do there."""

    passwords: Mapping[str, str] = field(repr=False)
    """By name."""
    access_control: Mapping[str, Any]
    """As phalanx.wire.access makes it."""
    certificates: Path | None = None
    """The folder of the hub's certificate; whoever has one of the same authority is let in, and
    no password is asked for."""


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
    config = {
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
    config["qos"] = {"network": [{**behind, "key_exprs": list(NOT_URGENT)}]}
    with contextlib.ExitStack() as stack:
        if admission is not None:
            config["access_control"] = dict(admission.access_control)
        if credentials is not None:
            _show(config, credentials)
        if admission is not None and admission.certificates is not None:
            own = config["transport"]["link"].setdefault("tls", {})
            own |= tls(admission.certificates, "listen")
        elif admission is not None:
            passwords = stack.enter_context(_file_in_memory(admission.passwords))
            auth = config["transport"].setdefault("auth", {}).setdefault("usrpwd", {})
            auth["dictionary_file"] = passwords
        # Whoever started this process may have been a client, and left it in the environment.
        if os.environ.get(_RUNTIME) == _CLIENT_RUNTIME:
            del os.environ[_RUNTIME]
        try:
            session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        except zenoh.ZError as error:
            raise HubError(f"cannot listen on {endpoint}: {_reason(error)}") from error
    close_at_once(session)
    return session


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
    if credentials is not None:
        _show(config, credentials)
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        # Who is refused is not told so: there is nothing to tell it from a hub that is not there.
        proof = "certificate" if credentials and credentials.certificates else "secret"
        cause = f"{_reason(error)}; is the {proof} the run's?" if credentials else _reason(error)
        raise HubError(f"no hub at {endpoint} within {timeout:g} s: {cause}") from error


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
        if _announced(session, token, min(patience, left)):
            return session
        session.close()  # type: ignore[no-untyped-call]
        patience *= 2.0
    raise HubError(f"nobody is there as {token} at {endpoint} after {timeout:g} s")


def _announced(session: zenoh.Session, token: str, timeout: float) -> bool:
    deadline = time.monotonic() + timeout
    while (left := deadline - time.monotonic()) > 0:
        if any(reply.ok is not None for reply in session.liveliness().get(token, timeout=left)):
            return True
        time.sleep(0.05)  # nobody has announced himself yet, so the query ended at once
    return False


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


def publisher(
    session: zenoh.Session, key: str, priority: zenoh.Priority = zenoh.Priority.DATA
) -> zenoh.Publisher:
    """A publisher whose messages are never dropped by a full queue: lockstep needs them all."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.BLOCK,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority,
    )


def urgent_publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """A publisher whose messages overtake others on their way: the hub allows the plant alone."""
    return publisher(session, key, zenoh.Priority.INTERACTIVE_HIGH)


def view_publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """A publisher that drops what a slow listener cannot take: it never holds up the plant."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=zenoh.Priority.DATA_LOW,
    )


def answer(session: zenoh.Session, key: str, payload: bytes) -> None:
    """Answer every query on the key with the same payload, until the close."""
    answer_each(session, key, lambda _: payload)


def answer_each(session: zenoh.Session, key: str, reply: Callable[[bytes], bytes | None]) -> None:
    """Answer each query on the key by what it asks, in Zenoh's own thread; None: not at all."""

    def on_query(query: zenoh.Query) -> None:
        payload = reply(query.payload.to_bytes() if query.payload else b"")
        if payload is not None:
            query.reply(key, payload)

    session.declare_queryable(key, zenoh.handlers.Callback(on_query, indirect=False))


def ask(
    session: zenoh.Session, key: str, timeout: float, question: bytes | None = None
) -> bytes | None:
    """The first answer to a query on the key, or None within `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while True:
        for reply in session.get(key, payload=question, timeout=min(timeout, 1.0)):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        if time.monotonic() > deadline:
            return None
        time.sleep(0.05)  # nobody has declared the key yet, so the query ended at once


def on_parting(session: zenoh.Session, parted: Callable[[], None]) -> None:
    """Call parted() when the hub is gone, at once if it is gone already.

    A liveliness token says so too, but only to who had seen it before.
    """

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            parted()

    session.info.declare_transport_events_listener(
        zenoh.handlers.Callback(on_event, indirect=False)
    )
    if not session.info.transports():
        parted()


def has_listener(publisher: zenoh.Publisher) -> bool:
    """Whether somebody listens now."""
    matching: bool = publisher.matching_status.matching  # type: ignore[attr-defined]
    return matching


def wait_for_listener(
    publisher: zenoh.Publisher, timeout: float, over: Callable[[], bool] = lambda: False
) -> None:
    """Wait until somebody listens: messages put earlier are lost.

    Raises HubError if nobody does within `timeout` seconds, or `over` before.
    """
    if has_listener(publisher):
        return
    listener = threading.Event()

    def on_match(status: zenoh.MatchingStatus) -> None:
        if status.matching:
            listener.set()

    publisher.declare_matching_listener(zenoh.handlers.Callback(on_match, indirect=False))
    deadline = time.monotonic() + timeout
    while not has_listener(publisher) and not listener.wait(_GLANCE):
        if over() or time.monotonic() > deadline:
            raise HubError(f"nobody listens to {publisher.key_expr} after {timeout:g} s")


def subscribe(session: zenoh.Session, key: str, deliver: Deliver) -> None:
    """Call deliver(key, payload) in Zenoh's own thread for every message, until the close.

    deliver may put, but must not wait for another message.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        deliver(str(sample.key_expr), sample.payload.to_bytes())

    session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))


class Addressed:
    """Puts messages on keys that have one listener each, and that nobody else is told of.

    A declared publisher that knows no subscriber sends nothing, and learns of a new one a moment
    late. Without one a client always sends, and the hub routes to whoever is there.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._known: dict[str, zenoh.KeyExpr] = {}
        """What the hub knows by a number: it finds their routes without reading them again."""

    def put(self, key: str, payload: bytes) -> None:
        """Put a message; it is never dropped by a full queue."""
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = self._session.declare_keyexpr(key)
        self._session.put(known, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def watch(session: zenoh.Session, key: str, changed: Callable[[str, bool], None]) -> None:
    """Call changed(key, alive) whenever a liveliness token appears or disappears.

    It is called in a thread of its own, so it may close things.
    """

    def on_token(sample: zenoh.Sample) -> None:
        changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    session.liveliness().declare_subscriber(key, on_token, history=True)


def announce(session: zenoh.Session, key: str) -> zenoh.LivelinessToken:
    """Declare a liveliness token; it disappears with the session, whatever ends it."""
    return session.liveliness().declare_token(key)


def _reason(error: Exception) -> str:
    # Zenoh appends source places; a user needs the cause only.
    return str(error).split(" at /")[0].rstrip(".")
