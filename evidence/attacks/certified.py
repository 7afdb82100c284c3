"""Attacks on a run with TLS certificates: with none, with a wrong one, or with the attacker's own.

The run's programs are started as on many hosts, each with the folder of its certificate. An
attacker with a certificate knows all secrets too: only the hub's access control limits it. One that
plays the hub listens on its endpoint first, while the agents try to connect, and then leaves it to
the plant.
"""

import datetime
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from phalanx_hosts.authority import Authority, make_identities, private_pem, write_identity

from phalanx.faults.commands import Command, CommandKind
from phalanx.guarantee.verdict import Summary, read_summary
from phalanx.messages.credentials import AUTHORITY, Admission, tls
from phalanx.messages.frames import CommandMessage
from phalanx.messages.keys import OPERATOR, PLANT, VIEWER, Keys
from phalanx.messages.seal import Sealer
from phalanx.recording.records import SUMMARY
from phalanx.scenario.load import load
from phalanx.wire import liveliness
from phalanx.wire.session import free_endpoint, open_hub
from tests.hostile.attacker import (
    INSIDER,
    OVERRIDES,
    PEER,
    READ,
    READY,
    SCENARIO,
    UNDER_WAY,
    VICTIM,
    Attack,
    Attacker,
    answers_for_another,
    assail,
    floods,
    opens_sessions,
    reads,
    withdraws_the_plant,
)

ROOT = Path(__file__).parents[2]
RUN, COMMAND_SECRET = "assailed", "known"
SPEED = 0.1
OURS, FOREIGN, EXPIRED = "ours", "foreign", "expired"
PLAYED = 5.0
"""For how long the hub is played when all agents try to connect [s of wall time]."""
_MONTH = datetime.timedelta(days=30)


class Shown(NamedTuple):
    """The identity with which an attacker connects."""

    authority: str
    """OURS, FOREIGN or EXPIRED."""
    name: str | None
    """In its certificate; None if it shows none."""
    attack: Attack
    plain: bool = False
    """Whether it speaks TCP to the port of TLS."""


def oversteps(by: Attacker) -> Iterator[None]:
    """Puts, declares, asks and listens where its certificate says nothing of."""
    keys = by.keys

    def say(_: object) -> None:
        print(READ, flush=True)

    with by.open() as session:
        session.declare_queryable("**", lambda query: query.reply(query.key_expr, b"?"))
        for key in ("**", keys.sample(VICTIM), keys.broadcast(VICTIM, PEER)):
            # Not what it puts itself.
            session.declare_subscriber(key, say, allowed_origin=zenoh.Locality.REMOTE)
        while True:
            for key in (
                *(keys.actuation(VICTIM), keys.telemetry(VICTIM), keys.sample(VICTIM)),
                *(keys.broadcast(VICTIM, PEER), keys.status, keys.verdict, keys.command, "**"),
            ):
                session.put(key, b"?" * 60)
            token = session.liveliness().declare_token(keys.alive(VICTIM, by.digest))
            token.undeclare()  # type: ignore[no-untyped-call]
            yield


def commands(by: Attacker) -> Iterator[None]:
    """Has agent 1 killed, under the command secret's seal."""
    command = Command(t=0.0, kind=CommandKind.KILL, agent=VICTIM)
    payload = Sealer(COMMAND_SECRET.encode()).seal(
        by.keys.command, CommandMessage(number=1, command=command)
    )
    with by.open() as session:
        while True:
            session.put(by.keys.command, payload)
            yield


def play_the_hub(endpoint: str, certificate: Path) -> None:
    """Be the plant for all who believe it."""
    keys = Keys(RUN)

    def say(_: object) -> None:
        print(READ, flush=True)

    everybody = Admission({}, {"enabled": False}, certificate)
    with open_hub(endpoint, everybody) as session:
        session.declare_subscriber(keys.everything, say)
        session.liveliness().declare_subscriber(
            keys.alive(VICTIM), lambda _: print(UNDER_WAY, flush=True)
        )
        _token = liveliness.announce(session, keys.alive(PLANT, "x"))
        print(READY, flush=True)
        while True:
            time.sleep(1.0)


HUBS = {
    f"{whose} certificate: plays the hub": name
    for whose, name in (("agent 3's", INSIDER), ("viewer's", VIEWER))
}
"""Whose certificate each shows."""
CERTIFIED: Mapping[str, Shown] = {
    "no certificate: reads": Shown(OURS, None, reads),
    "another authority's certificate: answers for another": Shown(
        FOREIGN, VICTIM, answers_for_another
    ),
    "expired certificate: withdraws the plant": Shown(EXPIRED, PLANT, withdraws_the_plant),
    "plain TCP to the port of TLS: floods": Shown(OURS, None, floods, plain=True),
    "no certificate: opens sessions": Shown(OURS, None, opens_sessions),
    "agent 3's certificate: answers for another": Shown(OURS, INSIDER, answers_for_another),
    "agent 3's certificate: puts, declares, asks": Shown(OURS, INSIDER, oversteps),
    "viewer's certificate: commands": Shown(OURS, VIEWER, commands),
    "viewer's certificate: answers for an agent": Shown(OURS, VIEWER, answers_for_another),
}


def attacked(attack: str) -> tuple[list[str], Summary]:
    """Run with an attacker; return its output and the run's summary."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    agents = [name for name, _, _ in load(SCENARIO, OVERRIDES).roster()]
    with tempfile.TemporaryDirectory() as parent:
        keys, folder = Path(parent) / "keys", Path(parent) / RUN
        _make_keys(keys, [PLANT, VIEWER, OPERATOR, *agents])
        attacker = _start(__file__, attack, endpoint, str(keys))
        of_run = ["--run", RUN, "--scenario", SCENARIO]
        of_run += [word for override in OVERRIDES for word in ("--set", override)]
        honest = keys / OURS
        running = []
        for name in agents:
            ends = ("--connect", endpoint, "--keys", str(honest / name))
            running.append(_start("-m", "phalanx", "agent", name, *ends, *of_run))
        if attack in HUBS:
            while not all(map(_connects, running)):
                time.sleep(0.1)
            time.sleep(PLAYED)
            attacker.kill()
        running.append(
            _start(
                *("-m", "phalanx", "plant", "--listen", endpoint, "--folder", str(folder), *of_run),
                *("--keys", str(honest / PLANT), "--speed", str(SPEED)),
            )
        )
        try:
            for program in running:
                program.communicate(timeout=120)
        finally:
            for program in (attacker, *running):
                program.kill()
            lines = attacker.communicate()[0].splitlines()
        return lines, read_summary((folder / SUMMARY).read_bytes())


def _make_keys(keys: Path, names: list[str]) -> None:
    """Folders of certificates by who signed them, or how long ago."""
    ours, _ = (make_identities(keys / of, names, ["127.0.0.1"], _MONTH) for of in (OURS, FOREIGN))
    # Signed by the run's own authority, and all right but for their dates.
    expired = x509.load_pem_x509_certificate(Authority.new(-_MONTH).certificate)
    long_ago = Authority(expired, ours.key)
    for name in names:
        (keys / EXPIRED / name).mkdir(parents=True)
        key = ec.generate_private_key(ec.SECP256R1())
        signed = long_ago.sign(name, key.public_key())
        write_identity(keys / EXPIRED / name, b"", signed, private_pem(key))


def _start(*arguments: str) -> subprocess.Popen[str]:
    command, quiet = [sys.executable, *arguments], subprocess.DEVNULL
    environment = {**os.environ, "PHALANX_COMMAND_SECRET": COMMAND_SECRET}
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=quiet, text=True, cwd=ROOT, env=environment
    )


def _connects(program: subprocess.Popen[str]) -> bool:
    """Return whether the program has a thread of Zenoh's, by its name."""
    threads = Path(f"/proc/{program.pid}/task").glob("*/comm")
    return any(thread.read_text().startswith("app-") for thread in threads)


def main() -> None:
    """Attack until killed."""
    name, endpoint, keys = sys.argv[1:]
    if name in HUBS:
        play_the_hub(endpoint, Path(keys) / OURS / HUBS[name])
    case = CERTIFIED[name]
    folder = Path(keys) / case.authority
    shows: dict[str, Any] = {"enable_mtls": False}
    if case.plain:
        endpoint = endpoint.replace("tls/", "tcp/")
    elif case.name is not None:
        shows = tls(folder / case.name, "connect")
    # The hub's authority is public: it would be admitted by a hub that only checked that.
    shows["root_ca_certificate"] = str(Path(keys) / OURS / VICTIM / AUTHORITY)
    at_full_speed = case.attack in (answers_for_another, floods)
    assail(Attacker(endpoint, RUN, b"", shows), case.attack, at_full_speed)


if __name__ == "__main__":
    main()
