"""Two hosts, a router on each, agents on both, certificates between all of them: one run.

The hosts are network namespaces with a real wire between them; see tests/network/testbed.py.
"""

import datetime
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from phalanx_hosts.authority import make_identities

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.messages.keys import PLANT, ROUTER
from tests.network import testbed
from tests.network.testbed import HERE, THERE, Wire, opened, unavailable
from tests.process.runs import wait_for

pytestmark = [
    pytest.mark.swarm,
    pytest.mark.nightly,
    pytest.mark.skipif(reason := unavailable() or False, reason=str(reason)),
]

SCENARIO, DURATION = "unicycles", "duration=0.5"
NORTH, SOUTH = f"tls/{HERE}:7447", f"tls/{THERE}:7447"
PLACES = {"1": NORTH, "2": NORTH, "3": SOUTH, "4": NORTH, "5": SOUTH}


class Hosts:
    """The programs of one run, each in its namespace with its own certificate."""

    def __init__(self, bed: testbed.Testbed, folder: Path) -> None:
        self.bed, self.keys, self.out = bed, folder / "keys", folder / "plant"
        self.out.mkdir()
        names = (PLANT, ROUTER, *PLACES)
        make_identities(self.keys, names, [HERE, THERE], datetime.timedelta(days=1))
        self.started: list[subprocess.Popen[str]] = []

    def start(self, host: str, program: str, *arguments: str) -> subprocess.Popen[str]:
        folder = self.keys / (arguments[0] if program == "agent" else program)
        common = ("--scenario", SCENARIO, "--set", DURATION, "--run", "r", "--keys", str(folder))
        namespace = self.bed.here if host == NORTH else self.bed.there
        command = (sys.executable, "-m", "phalanx", program, *common, *arguments)
        self.started.append(self.bed.start(namespace, *command))
        return self.started[-1]

    def start_routers(self) -> None:
        self.start(NORTH, "router", "--listen", NORTH)
        self.start(SOUTH, "router", "--listen", SOUTH, "--connect", NORTH)

    def start_plant(self) -> subprocess.Popen[str]:
        return self.start(NORTH, "plant", "--connect", NORTH, "--folder", str(self.out))

    def start_agents(self) -> list[subprocess.Popen[str]]:
        return [self.start(host, "agent", n, "--connect", host) for n, host in PLACES.items()]

    def end(self) -> None:
        for program in self.started:
            program.kill()
            program.communicate()


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Hosts]:
    with opened() as bed:
        started = Hosts(bed, tmp_path)
        yield started
        started.end()


@pytest.mark.parametrize("cut", [False, True], ids=["calm", "cut"])
def test_a_run_over_two_routers_is_the_run_on_one_host(hosts: Hosts, cut: bool) -> None:
    """Also when the wire between them is cut for a moment, and restored."""
    hosts.start_routers()
    plant, agents = hosts.start_plant(), hosts.start_agents()
    if cut:
        recording = hosts.out / "recording.mcap"
        wait_for(lambda: recording.exists() and recording.stat().st_size > 20_000)
        hosts.bed.wire = Wire(loss=1.0)
        with pytest.raises(subprocess.TimeoutExpired):
            plant.communicate(timeout=2.0)
        hosts.bed.wire = Wire()
    outputs = [program.communicate(timeout=120)[0] for program in (plant, *agents)]
    assert [program.returncode for program in (plant, *agents)] == [0] * 6, outputs
    summary = msgspec.json.decode((hosts.out / "summary.json").read_bytes(), type=Summary)
    alone = phalanx.run(phalanx.load(SCENARIO, [DURATION]), engine="in-process").summary
    assert summary.trajectory == alone.trajectory
    assert summary.outcome is alone.outcome
    assert not summary.rejected
