"""A run with TLS identities: the same trajectory, and programs without one are rejected."""

import contextlib
import datetime
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue

import msgspec
import pytest
import zenoh
from phalanx_hosts.authority import make_identities

import phalanx
from phalanx.faults.commands import Command, CommandKind
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.credentials import PRIVATE_KEY
from phalanx.messages.frames import CommandMessage
from phalanx.messages.keys import OPERATOR, PLANT, ROUTER, VIEWER, Keys
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Sealer
from phalanx.wire.session import HubError, free_endpoint, open_client, open_hub
from tests.layers import layered
from tests.process.leaks import files_of, leaks
from tests.process.runs import COMMAND_SECRET, wait_for

pytestmark = pytest.mark.swarm

SCENARIO = ("--scenario", "one-on-one", "--set", "duration=0.3", "--run", "r")
NAMES = [PLANT, ROUTER, VIEWER, OPERATOR, "1", "2"]
HOSTS = ["127.0.0.1"]
MONTH = datetime.timedelta(days=30)
BLOCK = zenoh.CongestionControl.BLOCK


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    make_identities(folder, NAMES, HOSTS, MONTH)
    return folder


class Programs:
    """A plant and agents as commands, on one TLS endpoint."""

    def __init__(self, keys: Path, out: Path) -> None:
        self.keys, self.out = keys, out
        self.endpoint = free_endpoint().replace("tcp/", "tls/")
        self.running = [self.start("plant", "--listen", self.endpoint, "--folder", str(out))]
        self.output = ""
        """All that they printed, once they have ended."""

    def start(self, program: str, *arguments: str) -> subprocess.Popen[str]:
        folder = self.keys / (arguments[0] if program == "agent" else program)
        command = [sys.executable, "-m", "phalanx", program, *arguments]
        command += [*SCENARIO, "--keys", str(folder)]
        return subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PHALANX_COMMAND_SECRET": COMMAND_SECRET.decode()},
        )

    def start_agents(self) -> None:
        self.running += [self.start("agent", n, "--connect", self.endpoint) for n in ("1", "2")]

    def membership(self, identity: str, keys: Path | None = None) -> Membership:
        """Return the membership of a program with a short timeout."""
        folder = keys or self.keys
        return Membership("r", self.endpoint, b"", identity, 1.5, folder / identity)

    def summary(self) -> Summary:
        """Return the run's summary when all programs have ended."""
        ended = [program.communicate(timeout=90) for program in self.running]
        assert [p.returncode for p in self.running] == [0] * len(self.running), ended
        self.output = "".join(out + err for out, err in ended)
        return msgspec.json.decode((self.out / "summary.json").read_bytes(), type=Summary)


@pytest.fixture
def programs(keys: Path, tmp_path: Path):
    started = Programs(keys, tmp_path)
    # The plant's answer: it listens.
    with open_patiently(started.membership(VIEWER)):
        pass
    yield started
    for program in started.running:
        program.kill()
        program.communicate()


def open_patiently(membership: Membership) -> zenoh.Session:
    return open_client(membership.endpoint, 60.0, membership.credentials)


def refused(membership: Membership) -> bool:
    """Return whether the hub rejects the program."""
    try:
        open_client(membership.endpoint, membership.timeout, membership.credentials).close()
    except HubError:
        return True
    return False


def test_certificates_keep_strangers_out_and_change_nothing(programs: Programs, tmp_path: Path):
    make_identities(other := tmp_path / "other", NAMES, HOSTS, MONTH)
    make_identities(expired := tmp_path / "expired", NAMES, HOSTS, -MONTH)
    plain = programs.endpoint.replace("tls/", "tcp/")
    assert refused(programs.membership("1", other)), "a certificate of another authority"
    assert refused(programs.membership("1", expired)), "one that is no longer valid"
    assert refused(Membership("r", plain, b"", "1", 1.5)), "plain TCP, with a password"
    bare = zenoh.Config.from_json5(bare_config(programs))
    with pytest.raises(zenoh.ZError):
        zenoh.open(bare)
    assert not refused(programs.membership("1"))
    programs.start_agents()
    with_certificates = programs.summary()
    alone = phalanx.run(phalanx.load("one-on-one", ["duration=0.3"]), engine="in-process").summary
    assert with_certificates.trajectory == alone.trajectory
    assert with_certificates.outcome is alone.outcome is Outcome.GUARANTEED
    private = {
        name: (programs.keys / name / PRIVATE_KEY).read_bytes().split(b"\n")[1] for name in NAMES
    }
    left_behind = {**files_of(programs.out), "output": programs.output.encode()}
    assert leaks({**private, "command secret": COMMAND_SECRET}, left_behind) == []


def test_who_has_a_certificate_speaks_for_himself_alone(programs: Programs):
    one = programs.membership("1")
    with open_patiently(one) as agent, open_patiently(programs.membership(ROUTER)) as witness:
        passed: list[str] = []
        witness.declare_subscriber(
            "phalanx/r/**",
            zenoh.handlers.Callback(lambda s: passed.append(str(s.key_expr)), indirect=False),
        )
        mine, last = one.keys.actuation("1"), one.keys.telemetry("1")
        # Until the hub knows of the subscriber, it sends it nothing.
        wait_for(lambda: agent.put(mine, b"?", congestion_control=BLOCK) or mine in passed)
        for key in (*not_of_1(one.keys), last):
            agent.put(key, b"?", congestion_control=BLOCK)
        agent.liveliness().declare_token(one.keys.alive("2", "d")).undeclare()
        wait_for(lambda: last in passed)
        assert set(passed) - {one.keys.status} == {mine, last}
    programs.start_agents()
    refusals = programs.summary().rejected
    assert set(refusals) == {"truncated"}, "what it said of itself, and nothing in another's name"


def not_of_1(keys: Keys) -> list[str]:
    """Return keys that agent 1 may not put on."""
    of_2 = [keys.actuation("2"), keys.telemetry("2"), keys.sample("2"), keys.broadcast("2", "1")]
    return [*of_2, keys.status, keys.verdict, keys.command, keys.scenario, "**", keys.everything]


@pytest.mark.parametrize("identity", layered((VIEWER, OPERATOR), (OPERATOR,)))
def test_only_the_operators_certificate_can_command(programs: Programs, identity: str):
    """Even with the command secret."""
    who = programs.membership(identity)
    key = who.keys.command
    command = Command(t=0.0, kind=CommandKind.LOSS, value=1.0)
    with open_patiently(who) as session:
        payload = Sealer(COMMAND_SECRET).seal(key, CommandMessage(number=1, command=command))
        session.put(key, payload, congestion_control=BLOCK)
        session.put(key, b"?" * 40, congestion_control=BLOCK)
        programs.start_agents()
        summary = programs.summary()
    assert summary.rejected == ({} if identity == VIEWER else {"command: bad seal": 1})


@contextlib.contextmanager
def pretended_hub(certificate: Path) -> Iterator[tuple[str, SimpleQueue[bool]]]:
    """The endpoint of who plays the hub with the certificate shown, and who has believed it."""
    context, believed = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), SimpleQueue[bool]()
    context.load_cert_chain(certificate / "tls.crt", certificate / "tls.key")
    context.load_verify_locations(certificate / "ca.crt")
    context.verify_mode = ssl.CERT_REQUIRED

    def play() -> None:
        with contextlib.suppress(OSError):  # shut down
            while True:
                connection, _ = listening.accept()
                try:
                    context.wrap_socket(connection, server_side=True).close()
                except OSError:
                    believed.put(False)
                else:
                    believed.put(True)
                    connection.close()

    with socket.create_server(("127.0.0.1", 0)) as listening:
        playing = threading.Thread(target=play)
        playing.start()
        try:
            yield f"tls/127.0.0.1:{listening.getsockname()[1]}", believed
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            playing.join()


def connect_until(answered: SimpleQueue[bool], who: Membership) -> bool:
    """Return the result of a program's first connection; it tries until one is answered."""
    if who.identity == ROUTER:
        with open_hub(free_endpoint(), None, [who.endpoint], who.credentials):
            return answered.get()
    while answered.empty():
        with contextlib.suppress(HubError):
            open_client(who.endpoint, 0.2, who.credentials).close()
    return answered.get()


@pytest.mark.parametrize("connects", [PLANT, ROUTER, VIEWER, OPERATOR, "1"])
@pytest.mark.parametrize("plays_the_hub", [PLANT, ROUTER, VIEWER, OPERATOR, "2"])
def test_none_but_plant_and_router_can_play_the_hub(
    connects: str, plays_the_hub: str, keys: Path
) -> None:
    with pretended_hub(keys / plays_the_hub) as (endpoint, answered):
        who = Membership("r", endpoint, b"", connects, identity_folder=keys / connects)
        assert connect_until(answered, who) == (plays_the_hub in (PLANT, ROUTER))


@pytest.mark.parametrize("connects", [ROUTER, "1"])
def test_a_hub_that_is_reached_by_another_name_than_its_own_is_not_believed(
    connects: str, tmp_path: Path
) -> None:
    make_identities(tmp_path, [PLANT, connects], ["plant.example.org"], MONTH)
    with pretended_hub(tmp_path / PLANT) as (endpoint, answered):
        who = Membership("r", endpoint, b"", connects, identity_folder=tmp_path / connects)
        assert not connect_until(answered, who)


def bare_config(programs: Programs) -> str:
    """A TLS client that trusts the authority and shows nothing."""
    tls = {"root_ca_certificate": str(programs.keys / "1" / "ca.crt"), "enable_mtls": False}
    connect = {"endpoints": [programs.endpoint], "timeout_ms": 1500}
    return msgspec.json.encode(
        {"mode": "client", "connect": connect, "transport": {"link": {"tls": tls}}}
    ).decode()
