"""docs/wire.md says what the messages are: they are written and read here as the page has it."""

import re
from pathlib import Path
from typing import Any

import msgpack
import pytest

from phalanx.messages import frames, kinds
from phalanx.messages.frames import AgentStatus
from phalanx.messages.keys import Keys
from phalanx.messages.kinds import VERSION, Message
from phalanx.messages.membership import Membership
from phalanx.messages.step_report import OF_ROW, QUANTITIES, AppliedStep, StepReport
from phalanx.network.link import Link, LinkModel, Stage
from phalanx.network.loss import RandomLoss

PAGE = (Path(__file__).parents[3] / "docs" / "wire.md").read_text(encoding="utf-8")
SECRET = b"secret"
MEMBERSHIP = Membership("r", "", SECRET)
OF_TYPE = {
    "int": 7,
    "float": 0.25,
    "float or null": None,
    "floats": [1.5, -2.0],
    "ints": [3, -1],
    "text": "qp",
    "texts": ["4", "5"],
    "bytes": b"\x00\x01",
    "bool": True,
}
# What the page says in words: arrays in arrays, and maps.
OF_FIELD = {
    "commands": [0.1, None, True, False, True],
    "ages": [[1, 0.01]],
    "convictions": [[1, 0.25, 0.26, 0.5]],
    "received": [[1, 0.25, [1.5, -2.0]]],
    "notes": [["gap", 0.25]],
    "fates": [[1, 6, 0.02, [2], [0.25, [1.5, -2.0], [0.5]]], [1, 7, -1.0, [], None]],
    "relays": [[1, 6, 0.25, [1.5], 0.2, [0.0, 1.0], [0.0, 1.0]]],
    "statements": [[0, [1, 6, 0.25, [1.5], 0.2, [0.0, 1.0], [0.0, 1.0]]]],
    "condition": "fine",
    "link_events": [[0, 1, 0.02]],
    "assumptions": [{"name": "a", "failed": 1, "checked": 2, "first": 0.5, "note": "n"}],
    "violations": [
        {
            "pair": "1-4",
            "first": 1.0,
            "worst": 0.1,
            "worst_at": 1.1,
            "duration": 0.2,
            "count": 2,
            "begin": 1.3,
            "end": None,
        }
    ],
    "log": [[0.5, "agent 4 killed"]],
    "command": {"t": 0.0, "kind": "pause", "agent": "", "value": 0.0, "fault": -1},
}
PARTS = {"StepReport": StepReport, "AppliedStep": AppliedStep, "AgentStatus": AgentStatus}


def tables() -> dict[str, list[tuple[str, str]]]:
    """(field, type) of every message but its version, as the page's tables have them."""
    sections = re.findall(r"^### (\w+)\n(.*?)(?=^##|\Z)", PAGE, re.DOTALL | re.MULTILINE)
    row = re.compile(r"^\| (\w+) \| ([\w ]+) \|", re.MULTILINE)
    return {name: row.findall(body)[1:] for name, body in sections}


def fields(name: str) -> list[Any]:
    """Return the fields of a message or a part, with examples of the page's types."""
    first = fields("StepReport") if name == "AppliedStep" else [] if name in PARTS else [VERSION]
    own = tables()[name]
    return first + [OF_FIELD.get(f) or example(t) for f, t in own]


def example(of_type: str) -> Any:
    """A value of a type; of an array of parts, or a part that may be null, the part."""
    part = of_type.removeprefix("array of ").removesuffix(" or null")
    if part not in PARTS:
        return OF_TYPE[of_type]
    return [fields(part)] if of_type.startswith("array of ") else fields(part)


MESSAGES: dict[str, type[Message]] = {
    name: kind
    for name, kind in {**vars(kinds), **vars(frames)}.items()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
}
"""Every message that there is, by name."""


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """The functions that the page shows."""
    scope: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(block, scope)
    return scope


def test_the_page_has_every_message_and_no_other():
    assert set(tables()) == {*MESSAGES, *PARTS}
    assert f"now **{VERSION}**" in PAGE


def test_the_draws_of_the_page_are_those_of_links(page):
    link = Link(7, "1", "2", LinkModel((Stage("loss", RandomLoss(0.5)),)))
    assert [page["draws"](7, "1", "2", k)[0] < 0.5 for k in range(300)] == [
        link.fate(k).delay is None for k in range(300)
    ]


@pytest.mark.parametrize("of", ["telemetry/4", "broadcast/4/5", "status/plant", "place/plant"])
@pytest.mark.parametrize("name", sorted(MESSAGES))
def test_a_message_written_from_the_page_is_read_and_read_back(name, of, page):
    kind, key, examples = MESSAGES[name], f"phalanx/r/{of}", fields(name)
    assert ["version", *[field for field, _ in tables()[name]]] == list(kind.__struct_fields__)
    message = MEMBERSHIP.sealer.open(key, page["sealed"](key, examples, SECRET), kind)
    again = MEMBERSHIP.sealer.seal(key, message)
    assert again[:16] == page["sealed"](key, msgpack.unpackb(again[16:]), SECRET)[:16]
    assert msgpack.unpackb(again[16:]) == examples


@pytest.mark.parametrize("name", PARTS)
def test_a_part_of_a_message_has_the_fields_that_the_page_says(name):
    own, config = [field for field, _ in tables()[name]], PARTS[name].__struct_config__
    assert config.array_like
    assert config.forbid_unknown_fields == (name != "AgentStatus")
    inherited = list(StepReport.__struct_fields__) if name == "AppliedStep" else []
    assert inherited + own == list(PARTS[name].__struct_fields__)


def test_the_page_has_every_number_of_a_step_in_its_unit():
    row = re.compile(r"^\| (\w+) \| [\w ]+ \|([^|]*)\|", re.MULTILINE)
    report, applied = (
        dict(row.findall(PAGE.split(f"\n### {name}\n")[1].split("\n### ")[0]))
        for name in ("StepReport", "AppliedStep")
    )
    for name, quantity in QUANTITIES.items():
        unit = "" if quantity.unit == OF_ROW else quantity.unit
        assert (report | applied)[name].strip() == unit


@pytest.mark.parametrize("name", ["", "4", "viewer", "1>2"])
def test_the_keys_and_passwords_of_the_page_are_those_of_the_code(name, page):
    assert page["key_of"](name, SECRET) == MEMBERSHIP.key_of(name)
    assert page["password_of"](name, SECRET) == MEMBERSHIP.password_of(name)


def test_the_keys_of_the_page_are_those_of_the_code():
    keys = Keys("RUN")
    of_agents = (keys.sample, keys.actuation, keys.telemetry)
    of_plant = {keys.status, keys.verdict, keys.frames, keys.scenario}
    of_plant |= {keys.command}
    keys_in_code = {key("AGENT") for key in of_agents} | of_plant
    keys_in_code |= {keys.broadcast("AGENT", "PEER"), keys.alive("NAME", "DIGEST")}
    assert set(re.findall(r"^\| (phalanx/\S+)", PAGE, re.MULTILINE)) == keys_in_code
