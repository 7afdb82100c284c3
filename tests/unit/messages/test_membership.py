"""The keys of each program of a run, and those that it cannot derive."""

import math
import pickle

import msgspec
import pytest

import phalanx
from phalanx.messages.credentials import Admission, Credentials
from phalanx.messages.frames import worse
from phalanx.messages.keys import PLANT, SHARED, VIEWER, Keys, kind_and_name, owner
from phalanx.messages.kinds import VERSION, Actuation, Broadcast, Status
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed, Sealer
from phalanx.messages.traffic import payload_bytes, traffic_in_words
from phalanx.network.inbox import BroadcastInbox
from phalanx.swarm.swarm import build_swarm

ROOT = Membership("r", "tcp/127.0.0.1:1", b"hidden", PLANT)
KEYS = Keys("r")
NAMES = ("4", "5", "6")


def test_a_program_gets_its_own_keys_and_nothing_from_which_others_could_be_made():
    agent = ROOT.of("4", ("4",), NAMES)
    assert agent.credentials == Membership("r", "", b"hidden", "4").credentials
    assert agent.key_of("4") == ROOT.key_of("4")
    assert agent.key_of(SHARED) == ROOT.key_of(SHARED)
    assert b"hidden" not in pickle.dumps(agent)
    assert "hidden" not in repr((ROOT, Admission({"4": "hidden"}, {}), Credentials("4", "hidden")))
    assert agent.key_of("4>5") == ROOT.key_of("4>5")
    assert agent.key_of("5>4") == ROOT.key_of("5>4")
    for other in ("5", "5>6", "6>5"):
        assert ROOT.key_of(other) not in pickle.dumps(agent)
    with pytest.raises(KeyError):
        agent.key_of("5")


def test_a_controller_gets_the_keys_of_those_that_it_decides_for():
    controller = ROOT.of("controller", ("1", "2"))
    assert controller.key_of("2") == ROOT.key_of("2")


@pytest.mark.parametrize("name", ["1", VIEWER, SHARED])
def test_the_proof_shown_to_join_is_no_key(name):
    assert bytes.fromhex(ROOT.password_of(name)) != ROOT.key_of(name)[:16]


def test_an_agent_cannot_seal_what_passes_between_another_and_the_plant():
    """Not even where the hub would let it put that."""
    key = KEYS.actuation("5")
    with pytest.raises(KeyError):
        ROOT.of("4").sealer.seal(key, Actuation(k=0, t_apply=0.0, u=()))
    member = Membership("r", "", held={"4": ROOT.key_of("4"), "5": ROOT.key_of("4")})
    payload = member.sealer.seal(key, Actuation(k=0, t_apply=0.0, u=()))
    with pytest.raises(Malformed, match="bad seal"):
        ROOT.sealer.open(key, payload, Actuation)


def test_both_ends_of_a_link_can_read_a_broadcast_and_no_other_can_make_it():
    key, said = KEYS.broadcast("4", "5"), Broadcast(k=0, t_apply=0.0, u=(1.0,))
    sender, receiver, other = (ROOT.of(name, (name,), NAMES) for name in "456")
    assert receiver.sealer.open(key, sender.sealer.seal(key, said), Broadcast) == said
    with pytest.raises(KeyError):
        other.sealer.seal(key, said)


def test_all_of_a_run_can_read_what_the_plant_says_to_all():
    for said in (Status(t=1.0), Status(t=math.nan)):
        payload = ROOT.sealer.seal(KEYS.status, said)
        assert repr(ROOT.of("5").sealer.open(KEYS.status, payload, Status)) == repr(said)
    assert {*msgspec.structs.astuple(Status())} == {VERSION, 0, None, ()}


@pytest.mark.parametrize(("a", "b", "of_both"), [(1.0, 2.0, 2.0), (2.0, -1.0, -1.0)])
def test_a_loss_is_worse_than_any_delay(a: float, b: float, of_both: float) -> None:
    assert worse(a, b) == worse(b, a) == of_both


@pytest.mark.parametrize("seal_under_other_secret", [b"", b"Secret", b"another"])
def test_another_secret_makes_other_keys(seal_under_other_secret):
    other = Membership("r", "", seal_under_other_secret)
    assert other.key_of("4") != ROOT.key_of("4")
    assert other.password_of("4") != ROOT.password_of("4")


@pytest.mark.parametrize(
    "key",
    ["", "**", "phalanx/**", "phalanx/r/**", "phalanx/r/*/*", "phalanx/r/actuation/*", "x/r/a/1",
     "phalanx/r/actuation", "phalanx/r/alive/1/d/e", "phalanx/*/actuation/1", "phalanx/r/act$*/1"],
)  # fmt: skip
def test_a_key_of_no_run_names_no_program(key):
    assert kind_and_name(key) == ("", "")
    assert owner(key) == SHARED


@pytest.mark.slow
@pytest.mark.parametrize("name", ["radio", "crossing"])
def test_the_size_is_that_of_the_largest_broadcast_of_a_run(name, monkeypatch):
    sizes, put = [], BroadcastInbox.put

    def measured(inbox, sender, message, *now):
        sizes.append(len(Sealer().seal("any", message)))
        return put(inbox, sender, message, *now)

    monkeypatch.setattr(BroadcastInbox, "put", measured)
    scenario = phalanx.load(name, {"duration": 1.2, "faults": [], "network.loss": 0.0})
    phalanx.run(scenario, engine="in-process")
    most = payload_bytes(build_swarm(scenario), 0)
    assert most - 20 <= max(sizes) <= most, "numbers of steps take a byte or three"


def test_words_name_each_kind_of_broadcast_and_nothing_where_none_is_heard():
    rogue = {"type": "give-way", "gains": [1.0], "speed": 1.5}
    of_one = {
        "radio": {"every": 5, "relays": 1},
        "goal": [[-6.0, 0.0]],
        "role": "normal",
        "law": rogue,
    }
    changes = {f"agents.1.{field}": value for field, value in of_one.items()}
    assert traffic_in_words(build_swarm(phalanx.load("crossing-radio", changes))) == (
        "4 a second and agent, of at most 409 bytes: 1.64 kB/s; "
        "4 a second and agent, of at most 213 bytes: 0.852 kB/s"
    )
    assert traffic_in_words(build_swarm(phalanx.load("centralised"))) == ""
