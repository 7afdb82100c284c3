"""[network] and [[faults]] as a scenario writes them: read, refused, written down again."""

import itertools
import tomllib
from dataclasses import dataclass

import pytest
from pydantic import ValidationError

from phalanx.faults.fault import AgentFacts, LinkEnds, RunFacts
from phalanx.faults.links import Partition
from phalanx.network.draws import Seeds
from phalanx.network.link import Link
from phalanx.network.presets import PRESETS
from phalanx.network.rule import DELIVER, DROP
from phalanx.scenario.load import from_json, load
from phalanx.scenario.model import to_json

ALL = """
[network]
preset = "lossy-wifi"
delay = { time = 0.02, jitter = 0.004, correlation = 0.25, distribution = "pareto" }
delay_floor = { time = 0.001, per_metre = 1e-4 }
loss = { mean = 0.05, burst = 5.0 }
loss_by_distance = { none_within = 20.0, all_beyond = 40.0 }
duplicate = 0.01
corrupt = 0.02
reorder = { probability = 0.25, gap = 5 }
trace = { t = [0.0, 0.1], delay = [0.01, -1.0] }
rate = { bits_per_second = 1e6, limit = 20 }
slot = 0.01

[[network.links]]
from = "1"
preset = "jammed"

[[faults]]
kind = "partition"
at = 1.0
for = 2.0
groups = [["1", "2"]]

[[faults]]
kind = "hold"
for = 0.5
to = "3"

[[faults]]
kind = "link"
at = 2.0
for = 1.0
loss = { mean = 0.5, burst = 5.0 }

[[faults]]
kind = "lie"
agent = "1"
for = 1.0
says = [1.0, 0.0]
to = ["2"]

[[faults]]
kind = "lie"
agent = "1"
for = 1.0
replay = 20

[[faults]]
kind = "restart"
rate = 0.1
for = 1.0

[[faults]]
kind = "sensor"
at = 2.0
for = 1.0
silent = true
agents = ["1"]
"""


WITHIN_ROBOTS = (("1", "1", "sample"), ("2", "2", "sample"), ("1", "1", "actuation"))


def with_tables(text: str) -> dict[str, object]:
    return {**tomllib.loads(text)}


def test_everything_that_may_be_declared_is_numbered_and_survives_being_written_down():
    scenario = load("unicycles", with_tables(ALL))
    declared = scenario.links().declared
    before = ["loss", "loss_by_distance", "duplicate", "corrupt", "trace", "rate"]
    fields = [*before, "delay", "reorder", "delay_floor", "slot"]
    assert declared[:10] == tuple(f"network.{field}" for field in fields)
    assert set(declared[10:-7]) == {f"network.links.0.{f}" for f in ("loss", "corrupt", "delay")}
    kinds = ("partition", "hold", "link", "lie", "lie", "restart", "sensor")
    assert declared[-7:] == tuple(f"faults.{n} ({kind})" for n, kind in enumerate(kinds))
    again = from_json(to_json(scenario))
    assert again == scenario
    assert again.links().model("1", "3") == scenario.links().model("1", "3")


def test_faults_act_on_the_links_that_they_concern_in_their_order():
    links = load("unicycles", with_tables(ALL)).links()
    faults = {
        link: [s.field for s in links.model(*link).stages if s.field.startswith("faults")]
        for link in (("1", "2"), ("1", "3"), ("3", "1"), ("2", "1"), *WITHIN_ROBOTS)
    }
    assert faults == {
        ("1", "2"): ["faults.2"],
        ("2", "1"): ["faults.2"],
        ("1", "3"): ["faults.0", "faults.2", "faults.1"],
        ("3", "1"): ["faults.0", "faults.2"],
        **dict(zip(WITHIN_ROBOTS, [["faults.6"], [], []], strict=True)),
    }
    stages = links.model("2", "3").stages
    assert stages[-1].field == "faults.1"


LATE = {"kind": "link", "at": 1.0, "for": 0.5, "delay": 0.6}
LOST = {"kind": "link", "at": 1.0, "for": 0.5, "loss": 1.0}
CUT = {"kind": "partition", "at": 1.0, "for": 0.5, "groups": [["1"]]}


@pytest.mark.parametrize(
    ("faults", "commanded", "during", "otherwise"),
    [
        ([LATE, CUT], None, None, 0.0),
        ([LATE, LOST], None, None, 0.0),
        ([{**LATE, "reorder": {"probability": 1.0}}], None, 0.0, 0.0),
        ([CUT], 0.2, None, 0.2),
    ],
    ids=["a partition", "another fault", "a rule of the same fault", "a command's delay"],
)
def test_a_fault_is_of_the_messages_sent_in_its_time_also_if_they_are_late(
    faults, commanded, during, otherwise
):
    links = load("unicycles", {"faults": faults}).links()
    link = Link(0, "1", "2", links.model("1", "2"))
    link.override(None, commanded)
    delays = [link.fate(k, sent=k / 10).delay for k in range(30)]
    assert delays == [during if 10 <= k < 15 else otherwise for k in range(30)]


@dataclass(frozen=True)
class Coin:
    """Loses every other message, by chance."""

    def treat(self, message):
        return DROP if message.draw("coin") < 0.5 else DELIVER


def test_two_rules_of_ones_own_in_one_fault_draw_each_for_itself():
    rules = [{"type": f"{__name__}:Coin"}] * 2
    fault = {"kind": "link", "for": 1.0, "rules": rules}
    links = load("unicycles", {"faults": [fault]}).links()
    link = Link(0, "1", "2", links.model("1", "2"))
    lost = [link.fate(k, distance=1.0).delay is None for k in range(4000)]
    assert sum(lost) / 4000 == pytest.approx(0.75, abs=0.03)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_the_fields_that_it_names_and_those_given_replace_its(name):
    plain = load("unicycles", {"network.preset": name})
    fields = {d.removeprefix("network.") for d in plain.links().declared}
    assert fields == set(PRESETS[name])
    quiet = load("unicycles", {"network.preset": name, "network.loss": 0.0})
    assert quiet.links().model("1", "2").loss == 0.0


@pytest.mark.parametrize(("shape", "fewest"), [("majority", 3), ("ring", 3), ("isolate", 2)])
def test_a_shape_that_would_cut_nothing_is_refused(shape, fewest):
    agents = {str(n): AgentFacts(False, (), ()) for n in range(fewest)}
    fault = Partition.model_validate({"kind": "partition", "for": 1.0, "shape": shape})
    fault.check(agents, ("faults", 0))
    names = tuple(agents)
    assert any(
        fault.on_links(RunFacts(names, 1.0, Seeds(0)), 0)(LinkEnds(*link))
        for link in itertools.permutations(names, 2)
    )
    agents.pop("0")
    with pytest.raises(ValidationError, match=f"expected {fewest} agents or more") as error:
        fault.check(agents, ("faults", 0))
    assert error.value.errors()[0]["loc"] == ("faults", 0, "shape")
