"""One attack on a live run, by a process of its own, which prints a line when it has begun.

A stranger knows the endpoint, the run's name and the scenario, but no secret. An insider takes part
as one agent, and has more than a real one: the run's whole secret to seal with, so that the hub's
access control alone decides what it may do.

python -m tests.hostile.attacker "stranger: withdraws the plant" tcp/127.0.0.1:7447 unicycles-1
"""

import json
import os
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import count
from typing import Any

import zenoh

from phalanx.faults.commands import ActiveCommands
from phalanx.messages.kinds import (
    MAX_BYTES,
    Actuation,
    Broadcast,
    Ended,
    Message,
    Sample,
    Telemetry,
)
from phalanx.messages.membership import Membership
from phalanx.messages.step_report import StepReport
from phalanx.scenario.load import load
from phalanx.scenario.model import digest
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin

SCENARIO, OVERRIDES = "unicycles", ("duration=0.5",)
VICTIM, PEER, INSIDER = "1", "2", "3"
READY, REFUSED, UNDER_WAY, READ = "ready", "refused", "under way", "read"
_PATIENCE = 3000
"""How long a session is tried for [ms]."""
_PACE = 0.02
"""Wall time between two blows of an attack that repeats [s]."""


class Attacker:
    """The target of an attack, and the attacker's knowledge."""

    def __init__(
        self, endpoint: str, run: str, secret: bytes | None, tls: Mapping[str, Any] | None = None
    ) -> None:
        """Aim it.

        Args:
            endpoint: of the hub. run: its name.
            secret: the run's, for an insider; None for a stranger.
            tls: Zenoh's settings of what certificate it shows, where the hub asks for one.
        """
        self._scenario = load(SCENARIO, OVERRIDES)
        self.digest = digest(self._scenario)
        self.endpoint, self.run, self._tls = endpoint, run, tls
        self.insider = bool(secret)
        self.membership = Membership(
            run, endpoint, b"guessed" if secret is None else secret, INSIDER
        )
        self.keys = self.membership.keys

    def wait_for_hub(self) -> None:
        """Return when something listens at the endpoint."""
        while True:
            with suppress(OSError), self.connect():
                return
            time.sleep(0.001)

    def connect(self) -> socket.socket:
        """A connection on which nothing was said yet. Raises OSError."""
        host, port = self.endpoint.partition("/")[2].split(":")
        return socket.create_connection((host, int(port)), timeout=1.0)

    def open(self, **link: Any) -> zenoh.Session:
        """A session as far as the hub lets one in. Raises zenoh.ZError."""
        retry = {"period_init_ms": 5, "period_max_ms": 20, "period_increase_factor": 1.1}
        connect = {"endpoints": [self.endpoint], "timeout_ms": _PATIENCE, "retry": retry}
        if self._tls is not None:
            link["tls"] = self._tls
        transport: dict[str, Any] = {"shared_memory": {"enabled": False}, "link": link}
        if self.insider:
            login = {"user": INSIDER, "password": self.membership.credentials.password}
            transport["auth"] = {"usrpwd": login}
        config = {
            "mode": "client",
            "connect": connect,
            "scouting": {"multicast": {"enabled": False}},
            "transport": transport,
        }
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))

    def sampling_instants(self, steps: int) -> list[float]:
        """Return the times of the victim's samples [s]."""
        swarm = build_swarm(self._scenario)
        clock, t, instants = swarm.clock(swarm.names.index(VICTIM)), 0.0, []
        for k in range(steps):
            instants.append(t)
            t = clock.after(k, t)
        return instants

    def forge(self, session: zenoh.Session, key: str, message: Message) -> None:
        """Put a message under the best seal that it can make."""
        session.put(key, self.membership.sealer.seal(key, message))


Attack = Callable[[Attacker], Iterator[None]]
"""Yields when it is under way, and again after each blow."""


def withdraws_the_plant(by: Attacker) -> Iterator[None]:
    yield from _declared_and_withdrawn(by, by.keys.alive("plant", "x"))


def withdraws_an_agent(by: Attacker) -> Iterator[None]:
    yield from _declared_and_withdrawn(by, by.keys.alive(VICTIM, by.digest))


def joins_with_another_scenario(by: Attacker) -> Iterator[None]:
    yield from _declared_and_withdrawn(by, by.keys.alive(VICTIM, "0123456789abcdef"))


def joins_before_the_agent(by: Attacker) -> Iterator[None]:
    with by.open() as session:
        _kept = session.liveliness().declare_token(by.keys.alive(VICTIM, by.digest))
        yield
        while True:
            yield


def declares_wildcard_tokens(by: Attacker) -> Iterator[None]:
    every = by.keys.everything
    yield from _declared_and_withdrawn(by, every, "**", f"phalanx/{by.run}/alive/**", "phalanx/**")


def puts_on_wildcards(by: Attacker) -> Iterator[None]:
    keys = by.keys.everything, "**", by.keys.actuation("*"), f"phalanx/{by.run}/*/*", "phalanx/**"
    with by.open() as session:
        while True:
            for key in keys:
                session.put(key, b"?" * 40)
            yield


def deletes_everything(by: Attacker) -> Iterator[None]:
    with by.open() as session:
        while True:
            session.delete("**")
            session.delete(by.keys.actuation(VICTIM))
            yield


def opens_sessions(by: Attacker) -> Iterator[None]:
    with by.open():
        yield
    sessions = []
    while True:
        with suppress(zenoh.ZError):
            sessions.append(by.open())
        if len(sessions) % 50 == 0:
            yield


def holds_connections_half_open(by: Attacker) -> Iterator[None]:
    """And opens each again that the hub closes."""
    connections: deque[socket.socket] = deque(maxlen=200)
    for n in count():
        with suppress(OSError):
            connections.append(by.connect())
        if n >= 200:
            yield


def never_reads(by: Attacker) -> Iterator[None]:
    session = by.open(tcp={"so_rcvbuf": 4096})
    # Nothing is read from the channel, so Zenoh's own thread blocks in it.
    _subscriber = session.declare_subscriber(by.keys.everything, zenoh.handlers.FifoChannel(1))
    yield
    while True:
        yield


def stops_reading(by: Attacker) -> Iterator[None]:
    session = by.open(tcp={"so_rcvbuf": 4096})
    _kept = session.declare_subscriber("**", _ignore)
    yield
    os.kill(os.getpid(), signal.SIGSTOP)


def _ignore(_: zenoh.Sample) -> None:
    pass


def reads(by: Attacker) -> Iterator[None]:
    def say(_: zenoh.Sample) -> None:
        print(READ, flush=True)

    with by.open() as session:
        session.declare_subscriber("**", zenoh.handlers.Callback(say, indirect=False))
        session.liveliness().declare_subscriber(
            "**", zenoh.handlers.Callback(say, indirect=False), history=True
        )
        yield
        while True:
            for reply in session.get(by.keys.scenario, timeout=1.0):
                if reply.ok is not None:
                    print(READ, flush=True)
            yield


def floods(by: Attacker) -> Iterator[None]:
    keys = [by.keys.actuation(VICTIM), by.keys.telemetry(VICTIM), by.keys.sample(VICTIM)]
    yield from _flooded(by, [*keys, by.keys.broadcast(VICTIM, PEER), by.keys.status], b"?" * 60)


def sends_large_messages(by: Attacker) -> Iterator[None]:
    yield from _flooded(by, [by.keys.actuation(VICTIM), by.keys.sample(VICTIM)], bytes(2_000_000))


def answers_for_another(by: Attacker) -> Iterator[None]:
    """Every sample, before the victim can: when it samples follows from the scenario."""
    key, report = by.keys.actuation(VICTIM), by.keys.telemetry(VICTIM)
    heard = by.keys.broadcast(VICTIM, PEER)
    u = (0.0, 0.0)
    with by.open() as session:
        while True:
            for k, t in enumerate(by.sampling_instants(60)):
                by.forge(session, key, Actuation(k=k, t_apply=t, u=u))
                by.forge(session, heard, Broadcast(k=k, t_apply=t, u=u))
                step_report = StepReport(origin=Origin.QP, residual=0.0, u_nom=u, solve_time=0.0)
                by.forge(session, report, Telemetry(k=k, report=step_report, ages=()))
            yield


def orders_another_to_die(by: Attacker) -> Iterator[None]:
    key = by.keys.sample(VICTIM)
    with by.open() as session:
        while True:
            for k in range(200):
                commands = ActiveCommands(die=True)
                sample = Sample(
                    k=k,
                    t=0.01 * k,
                    seen=(0, 1, 2, 3, 4),
                    x=bytes(120),
                    hearers=(),
                    commands=commands,
                )
                by.forge(session, key, sample)
            yield


def speaks_for_the_plant(by: Attacker) -> Iterator[None]:
    with by.open() as session:
        session.declare_queryable("**", lambda query: query.reply(query.key_expr, b"?"))
        while True:
            by.forge(session, by.keys.verdict, Ended(summary=b"{}"))
            yield


def fills_inboxes(by: Attacker) -> Iterator[None]:
    """Flood with its own broadcasts, numbered far ahead."""
    key, first = by.keys.broadcast(INSIDER, VICTIM), 10**6
    with by.open() as session:
        while True:
            for k in range(first, first + 1000):
                by.forge(session, key, Broadcast(k=k, t_apply=1.0, u=(0.0, 0.0)))
            first += 1000
            yield


def floods_the_plant(by: Attacker) -> Iterator[None]:
    own = by.keys.actuation(INSIDER), by.keys.telemetry(INSIDER)
    yield from _flooded(by, list(own), b"?" * 60)


def sends_the_largest_reports(by: Attacker) -> Iterator[None]:
    yield from _flooded(by, [by.keys.telemetry(INSIDER)], bytes(MAX_BYTES))


def reports_enormous_numbers(by: Attacker) -> Iterator[None]:
    """On every sample, before its own program can."""
    key, most = by.keys.telemetry(INSIDER), 1.7e308
    with by.open() as session:
        while True:
            for k in range(60):
                step_report = StepReport(
                    origin=Origin.QP, residual=0.0, u_nom=(most, -most), solve_time=most,
                    margin=most,
                )  # fmt: skip
                by.forge(session, key, Telemetry(k=k, report=step_report, ages=((0, most),)))
            yield


def floods_a_peer(by: Attacker) -> Iterator[None]:
    yield from _flooded(by, [by.keys.broadcast(INSIDER, VICTIM)], b"?" * 60)


STRANGERS: dict[str, Attack] = {
    f"stranger: {name}": attack
    for name, attack in {
        "withdraws the plant": withdraws_the_plant,
        "withdraws an agent": withdraws_an_agent,
        "joins with another scenario": joins_with_another_scenario,
        "joins before the agent": joins_before_the_agent,
        "declares wildcard tokens": declares_wildcard_tokens,
        "puts on wildcards": puts_on_wildcards,
        "deletes everything": deletes_everything,
        "opens sessions": opens_sessions,
        "holds 200 connections half-open": holds_connections_half_open,
        "subscribes and never reads": never_reads,
        "subscribes and is stopped": stops_reading,
        "reads": reads,
        "floods": floods,
        "sends large messages": sends_large_messages,
    }.items()
}
INSIDERS: dict[str, Attack] = {
    f"insider: {name}": attack
    for name, attack in {
        "answers for another": answers_for_another,
        "orders another to die": orders_another_to_die,
        "speaks for the plant": speaks_for_the_plant,
        "withdraws the plant": withdraws_the_plant,
        "withdraws an agent": withdraws_an_agent,
        "joins with another scenario": joins_with_another_scenario,
        "puts on wildcards": puts_on_wildcards,
        "declares wildcard tokens": declares_wildcard_tokens,
        "fills inboxes": fills_inboxes,
        "floods others": floods,
        "floods the plant in his own name": floods_the_plant,
        "floods a peer in his own name": floods_a_peer,
        "sends the largest reports in his own name": sends_the_largest_reports,
        "reports enormous numbers": reports_enormous_numbers,
    }.items()
}
ATTACKS = {**STRANGERS, **INSIDERS}
_AT_FULL_SPEED = ("flood", "large", "answers", "orders", "enormous")


def is_at_full_speed(attack: str) -> bool:
    """Return whether an attack goes as fast as its processor, which slows a run."""
    return any(word in attack for word in _AT_FULL_SPEED)


def _declared_and_withdrawn(by: Attacker, *keys: str) -> Iterator[None]:
    with by.open() as session:
        while True:
            for key in keys:
                token = session.liveliness().declare_token(key)
                token.undeclare()  # type: ignore[no-untyped-call]
            yield


def _flooded(by: Attacker, keys: list[str], payload: bytes) -> Iterator[None]:
    with by.open() as session:
        publishers = [
            session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
            for key in keys
        ]
        while True:
            for publisher in publishers:
                publisher.put(payload)
            yield


def main() -> None:
    """Attack until killed; a first line says whether the hub let it in."""
    name, endpoint, run, *secret = sys.argv[1:]
    attacker = Attacker(endpoint, run, bytes.fromhex(secret[0]) if secret else None)
    assail(attacker, ATTACKS[name], is_at_full_speed(name))


def assail(attacker: Attacker, attack: Attack, at_full_speed: bool) -> None:
    """Attack from when the hub listens until killed; say how it goes."""
    print(READY, flush=True)
    attacker.wait_for_hub()
    try:
        for blow, _ in enumerate(attack(attacker)):
            if blow == 0:
                print(UNDER_WAY, flush=True)
            if not at_full_speed:
                time.sleep(_PACE)
    except zenoh.ZError as error:
        print(f"{REFUSED}: {error}", flush=True)


if __name__ == "__main__":
    main()
