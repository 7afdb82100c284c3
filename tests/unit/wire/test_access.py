"""The rules by which the hub passes messages on."""

from typing import Any

from phalanx.wire.access import access_control
from phalanx.wire.keys import Keys

NAMES = ("4", "5", "6")
RULES = access_control(Keys("r"), {name: (name,) for name in NAMES}, NAMES)


def rules_of(name: str) -> list[dict[str, Any]]:
    (policy,) = (policy for policy in RULES["policies"] if policy["subjects"] == [name])
    by_id = {rule["id"]: rule for rule in RULES["rules"]}
    return [by_id[number] for number in policy["rules"]]


def test_no_two_rules_are_the_same():
    contents = [{**rule, "id": None} for rule in RULES["rules"]]
    assert all(contents.count(rule) == 1 for rule in contents)
    assert len({rule["id"] for rule in RULES["rules"]}) == len(contents)


def test_agents_share_the_rules_in_which_no_agent_is_named():
    shared = [rule for rule in rules_of("4") if rule in rules_of("5")]
    assert shared
    for rule in rules_of("4"):
        assert any("4" in key.split("/") for key in rule["key_exprs"]) != (rule in shared)


def test_an_agent_may_do_nothing_in_the_name_of_another():
    for rule in rules_of("4"):
        assert not {"5", "6"} & {chunk for key in rule["key_exprs"] for chunk in key.split("/")}
