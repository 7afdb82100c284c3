"""The rules by which the hub passes messages on."""

from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest
import zenoh

from phalanx.messages.admission import access_control, admission
from phalanx.messages.credentials import Admission, Credentials
from phalanx.messages.keys import OPERATOR, PLANT, ROUTER, VIEWER, Keys
from phalanx.messages.membership import Membership
from phalanx.wire.session import free_endpoint, open_client, open_hub
from tests.process.runs import wait_for
from tests.unit.swarms import swarm_of_scenario

NAMES = ("4", "5", "6")
KEYS = Keys("r")
RULES = access_control(KEYS, {name: (name,) for name in NAMES}, NAMES)
OF_OTHERS = [KEYS.sample("5"), KEYS.actuation("5"), KEYS.telemetry("5"), KEYS.broadcast("5", "6"),
             KEYS.broadcast("4", "5"), KEYS.frames, KEYS.command]  # fmt: skip
"""What is put neither by agent 4 nor for it, or by it for another."""


def rules_of(name: str, of: dict[str, Any] = RULES) -> list[dict[str, Any]]:
    (policy,) = (policy for policy in of["policies"] if policy["subjects"] == [name])
    by_id = {rule["id"]: rule for rule in of["rules"]}
    return [by_id[number] for number in policy["rules"]]


def test_no_two_rules_are_the_same():
    contents = [{**rule, "id": None} for rule in RULES["rules"]]
    assert all(contents.count(rule) == 1 for rule in contents)
    assert len({rule["id"] for rule in RULES["rules"]}) == len(contents)


def test_an_agent_may_do_nothing_in_the_name_of_another():
    for rule in rules_of("4"):
        assert not {"5", "6"} & {chunk for key in rule["key_exprs"] for chunk in key.split("/")}


def test_an_agent_that_no_other_hears_may_send_no_broadcasts():
    rules = access_control(KEYS, {name: (name,) for name in NAMES}, ("5",))
    for name in ("4", "5"):
        puts = [rule for rule in rules_of(name, rules) if "put" in rule["messages"]]
        keys = {k for rule in puts if rule["flows"] == ["ingress"] for k in rule["key_exprs"]}
        assert keys >= {KEYS.actuation(name), KEYS.telemetry(name)}
        assert (KEYS.broadcast(name, "*") in keys) == (name == "5")


@pytest.mark.parametrize("key", OF_OTHERS)
def test_an_agent_is_shown_nothing_that_is_for_another(key: str) -> None:
    put, shows = zenoh.KeyExpr(key), {("egress", "put"), ("ingress", "declare_subscriber")}
    for rule in rules_of("4"):
        if any((rule["flows"][0], message) in shows for message in rule["messages"]):
            assert not any(put.intersects(zenoh.KeyExpr(shown)) for shown in rule["key_exprs"])


def test_an_agent_that_subscribes_to_everybodys_broadcasts_hears_its_own_alone() -> None:
    endpoint, heard = free_endpoint(), SimpleQueue[str]()

    def opened(name: str) -> zenoh.Session:
        return open_client(endpoint, 60.0, Credentials(name, "p"))

    with (
        open_hub(endpoint, Admission(dict.fromkeys(NAMES, "p"), RULES)),
        opened("4") as listening,
        opened("5") as speaking,
    ):
        keys = KEYS.broadcast("*", "*"), KEYS.broadcast("5", "6"), KEYS.everything, "**"
        for key in (*keys, KEYS.broadcast("*", "4")):
            listening.declare_subscriber(key, lambda sample: heard.put(str(sample.key_expr)))
        last = speaking.declare_publisher(KEYS.broadcast("5", "4"))
        wait_for(lambda: last.matching_status.matching)
        # In this order they would come: what it hears first is all that it does.
        for key in (KEYS.broadcast("5", "6"), KEYS.broadcast("5", "4")):
            speaking.put(key, b"?", congestion_control=zenoh.CongestionControl.BLOCK)
        assert heard.get() == KEYS.broadcast("5", "4")


def test_a_viewer_gets_nothing_that_is_waited_for():
    """Else one that stops to read would hold up those who put it."""
    waited_for = (KEYS.sample("4"), KEYS.actuation("4"), KEYS.telemetry("4"))
    (rule,) = (r for r in rules_of(VIEWER) if r["flows"] == ["egress"] and r["messages"] == ["put"])
    expressions = [zenoh.KeyExpr(key) for key in rule["key_exprs"]]
    for key in (*waited_for, KEYS.broadcast("4", "5"), KEYS.command):
        assert not any(e.intersects(zenoh.KeyExpr(key)) for e in expressions)


@pytest.mark.parametrize(
    ("identity", "commanding"),
    [(None, {VIEWER, OPERATOR, ROUTER}), (Path("keys"), {OPERATOR, ROUTER})],
)
def test_a_viewer_may_command_where_no_certificate_tells_it_from_an_operator(
    identity: Path | None, commanding: set[str]
) -> None:
    swarm = swarm_of_scenario("unicycles")
    rules = admission(swarm, Membership("r", "", identity_folder=identity)).access_control
    assert {name for name in (*swarm.names, *commanding, VIEWER) if
            may(rules, name, "ingress", "put", KEYS.command)} == commanding  # fmt: skip


@pytest.mark.parametrize("name", ["4", VIEWER, OPERATOR])
def test_any_program_may_see_whether_the_plant_lives(name: str) -> None:
    plant = KEYS.alive(PLANT)
    assert may(RULES, name, "ingress", "declare_liveliness_subscriber", plant)
    assert may(RULES, name, "ingress", "liveliness_query", plant)
    assert may(RULES, name, "egress", "liveliness_token", plant)
    assert not may(RULES, name, "ingress", "liveliness_token", plant), "nor pass for it"


def test_no_program_comes_in_as_the_plant_where_that_is_the_hub_itself():
    assert PLANT not in {subject["id"] for subject in RULES["subjects"]}
    shared = access_control(KEYS, {"4": ("4",)}, NAMES, with_plant=True)
    assert may(shared, PLANT, "ingress", "put", KEYS.sample("4"))
    for hub in (PLANT, ROUTER):
        admitted = admission(swarm_of_scenario("unicycles"), Membership("r", "", b"s", hub))
        assert (PLANT in admitted.passwords) == (hub == ROUTER)
        assert not any(word in repr(admitted) for word in admitted.passwords.values())


def may(rules: dict[str, Any], name: str, flow: str, message: str, key: str) -> bool:
    """Return whether a program may send or receive this message of Zenoh's on a key."""
    return any(
        rule["flows"] == [flow] and message in rule["messages"]
        and any(zenoh.KeyExpr(shown).includes(zenoh.KeyExpr(key)) for shown in rule["key_exprs"])
        for rule in rules_of(name, rules)
    )  # fmt: skip
