"""Agents without numbers: each gets a place, and may then be that agent and no other."""

import datetime
from pathlib import Path

import msgspec
import pytest
import zenoh

from phalanx.guarantee.verdict import Summary
from phalanx.hosts.authority import make_identities
from phalanx.launcher.engine import RunOptions, execute
from phalanx.scenario.load import load
from phalanx.wire.keys import CLAIMANT, PLANT, ROUTER
from phalanx.wire.liveliness import announce
from phalanx.wire.membership import Membership
from phalanx.wire.session import free_endpoint, open_client

pytestmark = pytest.mark.swarm

REMOTE = zenoh.Locality.REMOTE
HOSTS, MONTH = ["127.0.0.1"], datetime.timedelta(days=30)
SHORT = "duration=0.3"
FOR_ALL = "duration=10"
"""Takes longer than the last of three programs that start at once lags behind the first."""
DIES = 'faults=[{kind="restart", at=0.1, for=0.05, agents=["2"]}]'


class Site:
    """A plant and what claimants need to reach it."""

    def __init__(self, phalanx, out: Path, *overrides: str, claims: bool = True) -> None:
        self.keys, self.out, self.overrides = out / "keys", out / "plant", overrides
        self.out.mkdir()
        make_identities(self.keys, [PLANT, ROUTER, CLAIMANT], HOSTS, MONTH, claims)
        self.endpoint = free_endpoint().replace("tcp/", "tls/")
        self._phalanx = phalanx
        self.plant = self.start("plant", PLANT, "--listen", self.endpoint, "--out", str(self.out))

    def start(self, program: str, identity: str, *arguments: str, overrides: tuple[str, ...] = ()):
        scenario = [part for o in (overrides or self.overrides) for part in ("--set", o)]
        common = ("--scenario", "one-on-one", "--run", "r", "--keys", str(self.keys / identity))
        return self._phalanx(program, *arguments, *common, *scenario)

    def start_claimant(self, *overrides: str):
        where = ("--claim", "--connect", self.endpoint)
        return self.start("agent", CLAIMANT, *where, overrides=overrides)

    def membership(self, identity: str) -> Membership:
        return Membership("r", self.endpoint, b"", identity, 60.0, self.keys / identity)

    def summary(self) -> Summary:
        """Wait for the plant, and return the summary."""
        status, said = self.plant.finish()
        assert status == 0, said
        return msgspec.json.decode((self.out / "summary.json").read_bytes(), type=Summary)


def into(payloads: list[bytes]) -> zenoh.handlers.Callback:
    """Make a callback that appends payloads to a list."""
    return zenoh.handlers.Callback(lambda m: payloads.append(m.payload.to_bytes()), indirect=False)


def alone(folder: Path, *overrides: str) -> Summary:
    """Run the scenario on one host, in one process."""
    (into := folder / "alone").mkdir()
    return execute(load("one-on-one", overrides), into, RunOptions("in-process"))


def test_claimants_that_nobody_numbered_make_the_run(phalanx, tmp_path: Path) -> None:
    site = Site(phalanx, tmp_path, FOR_ALL)
    claimants = [site.start_claimant() for _ in range(3)]
    summary = site.summary()
    ended = [claimant.finish() for claimant in claimants]
    assert [status for status, _ in ended] == [0, 0, 0]
    assert sum("got the place of" in said for _, said in ended) == 2, "the third was a spare"
    assert summary.trajectory == alone(tmp_path, FOR_ALL).trajectory
    assert not summary.rejected


@pytest.mark.nightly
def test_a_spare_takes_the_place_of_an_agent_that_died(phalanx, tmp_path: Path) -> None:
    site = Site(phalanx, tmp_path, SHORT, DIES)
    claimants = [site.start_claimant() for _ in range(3)]
    summary = site.summary()
    ended = [claimant.finish() for claimant in claimants]
    assert sorted(status for status, _ in ended) == [-9, 0, 0]
    assert [said.count("got the place of") for _, said in ended] == [1, 1, 1]
    assert summary.trajectory == alone(tmp_path, SHORT, DIES).trajectory


def test_who_claims_may_ask_and_nothing_else(phalanx, tmp_path: Path) -> None:
    site = Site(phalanx, tmp_path, SHORT)
    claimant, router = site.membership(CLAIMANT), site.membership(ROUTER)
    keys, heard, seen = claimant.keys, [], []
    with (
        open_client(router.endpoint, 60.0, router.credentials) as watching,
        open_client(claimant.endpoint, 60.0, claimant.credentials) as asking,
    ):
        # What a session puts itself it also hears, whatever the hub says.
        asking.declare_subscriber(keys.everything, into(heard), allowed_origin=REMOTE)
        watching.declare_subscriber(keys.everything, into(seen))
        own = [announce(asking, keys.alive(name, "d")) for name in ("1", PLANT)]
        agent_s = (keys.actuation("1"), keys.telemetry("1"), keys.broadcast("1", "2"))
        for key in (*agent_s, keys.sample("1"), keys.status, keys.command):
            asking.put(key, b"?", congestion_control=zenoh.CongestionControl.BLOCK)
        assert not list(asking.get(keys.scenario, timeout=1.0)), "nor see the scenario"
        assert list(watching.get(keys.scenario, timeout=60.0)), "which is there"
        tokens = [str(r.ok.key_expr) for r in watching.liveliness().get(keys.alive("*"))]
        assert [key.split("/")[3] for key in tokens] == [PLANT]
        del own
        for _ in range(2):
            site.start_claimant()
        summary = site.summary()
    assert not heard
    assert seen
    assert b"?" not in seen
    assert summary.trajectory == alone(tmp_path, SHORT).trajectory
    assert not summary.rejected


@pytest.mark.nightly
def test_another_scenario_gets_no_place_and_breaks_nothing(phalanx, tmp_path: Path) -> None:
    site = Site(phalanx, tmp_path, SHORT)
    status, said = site.start_claimant("duration=0.4").finish()
    assert status == 3
    assert "no place in run r: start it with the plant's --scenario" in said.splitlines()[-1]
    for _ in range(2):
        site.start_claimant()
    assert site.summary().trajectory == alone(tmp_path, SHORT).trajectory


def test_a_plant_that_cannot_sign_says_so(phalanx, tmp_path: Path) -> None:
    site = Site(phalanx, tmp_path, SHORT, claims=False)
    status, said = site.start_claimant().finish()
    assert status == 3
    assert "made without `phalanx keys --claims`" in said.splitlines()[-1]


@pytest.mark.nightly
def test_with_a_secret_alone_a_claim_is_a_choice_of_name(
    phalanx, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PHALANX_SECRET", "s")
    common = ("--scenario", "one-on-one", "--set", SHORT, "--run", "r")
    endpoint = free_endpoint()
    plant = phalanx("plant", *common, "--listen", endpoint, "--out", str(tmp_path))
    for _ in range(2):
        phalanx("agent", "--claim", *common, "--connect", endpoint)
    assert plant.finish()[0] == 0
    summary = msgspec.json.decode((tmp_path / "summary.json").read_bytes(), type=Summary)
    assert summary.trajectory == alone(tmp_path, SHORT).trajectory
