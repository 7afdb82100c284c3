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
from phalanx.scenario.model import ScenarioError, to_json

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


def partition(**fields: object) -> dict[str, object]:
    return {"faults": [{"kind": "partition", "for": 1.0, **fields}]}


def lie(**fields: object) -> dict[str, object]:
    return {"faults": [{"kind": "lie", "agent": "2", "for": 1.0, **fields}]}


BROKEN = {
    "a share that bursts cannot make up": (
        {"network.loss": {"mean": 0.9, "burst": 2.0}},
        ["network.loss: expected burst >= 9 for a mean loss of 0.9"],
    ),
    "a number of netem": (
        {"network.loss": {"mean": 0.1, "burst": 4.0, "1-k": 0.1}},
        ["network.loss.1-k: unknown field"],
    ),
    "a distribution that nobody knows": (
        {"network.delay": {"time": 0.1, "jitter": 0.1, "distribution": "cauchy"}},
        ["network.delay.distribution: expected 'uniform', 'normal', 'pareto' or 'paretonormal'"],
    ),
    "a jitter alone": (
        {"network.delay": {"jitter": 0.1}},
        ["network.delay.time: expected a value, got nothing"],
    ),
    "correlation one": (
        {"network.delay": {"time": 0.1, "jitter": 0.1, "correlation": 1.0}},
        ["network.delay.correlation: expected less than 1", "got 1.0"],
    ),
    "distances the wrong way round": (
        {"network.loss_by_distance": {"none_within": 9.0, "all_beyond": 3.0}},
        ["network.loss_by_distance: expected none_within <= all_beyond, got 9.0 > 3.0"],
    ),
    "a gap of nothing": (
        {"network.reorder": {"gap": 0}},
        ["network.reorder.gap: expected greater than or equal to 1"],
    ),
    "an unknown preset": (
        {"network.preset": "carrier-pigeon"},
        ["network.preset: expected 'lan', 'wifi'", "got 'carrier-pigeon'"],
    ),
    "a rule that is none": (
        {"network.rules": [{"type": "dataclasses:Field"}]},
        [
            "network.rules.0: expected a dataclass that is a Rule: Field (",
            "lacks treat(self, message)",
        ],
    ),
    "a fault of no kind": (
        {"faults": [{"kind": "gremlin", "for": 1.0}]},
        ["faults.0: ", "'partition', 'hold', 'link', 'lie', 'kill', 'restart'"],
    ),
    "a fault without end": (
        {"faults": [{"kind": "hold"}]},
        ["faults.0.for: expected a value, got nothing"],
    ),
    "samples held back": (
        {"faults": [{"kind": "hold", "for": 1.0, "of": "sample"}]},
        ["faults.0.of: expected broadcast or actuation"],
    ),
    "an unknown agent in a group": (
        partition(groups=[["9"]]),
        ["faults.0.groups: expected an agent's name, one of", "got '9'"],
    ),
    "in two groups at once": (
        partition(groups=[["1"], ["2", "1"]]),
        ["faults.0.groups: expected '1' in one group"],
    ),
    "all agents in one group": (
        partition(groups=[["1", "2", "3", "4", "5"]]),
        ["faults.0.groups: expected two groups, or an agent in no group"],
    ),
    "groups and a shape": (
        partition(groups=[["1"]], shape="ring"),
        ["faults.0: expected groups, or a shape"],
    ),
    "an unknown liar": (
        lie(agent="9", says="zero"),
        ["faults.0.agent: expected an agent"],
    ),
    "a lie to oneself": (
        lie(to=["2"], says="zero"),
        ["faults.0.to: expected an agent's name, one of ['1', '3'", "got '2'"],
    ),
    "a lie without content": (
        lie(),
        [
            "faults.0: expected one of says, equivocate, replay, apply_time, shift, drift, silent, "
            "got 'none'"
        ],
    ),
    "two lies in one": (lie(says="zero", replay=3), ["faults.0: expected one of says", "replay"]),
    "a word that is no lie": (
        lie(says="please"),
        ["faults.0.says: expected 'opposite' or 'zero', got 'please'"],
    ),
    "an input of another size": (lie(says=[1.0]), ["faults.0.says: expected 2 components"]),
    "an input too large to send": (
        lie(says=[0.0, -1e301]),
        ["faults.0.says.1: expected at most 1e+300 in size", "got -1e+301"],
    ),
    "an apply time too late to send": (
        lie(apply_time=1e301),
        ["faults.0.apply_time: expected at most 1e+300 in size", "got 1e+301"],
    ),
    "a replay of the future": (lie(replay=0), ["faults.0.replay: expected greater than or equal"]),
    "a fault of an unknown agent": (
        {"faults": [{"kind": "kill", "at": 1.0, "agents": ["9"]}]},
        ["faults.0.agents: expected an agent's name, one of", "got '9'"],
    ),
    "at a time and at random": (
        {"faults": [{"kind": "kill", "at": 1.0, "rate": 1.0}]},
        ["faults.0: expected at, or a rate"],
    ),
    "a pause without end": (
        {"faults": [{"kind": "pause", "at": 1.0}]},
        ["faults.0.for: expected a value, got nothing"],
    ),
    "an adversary that turns": (
        {"faults": [{"kind": "turn", "at": 1.0, "agents": ["4"]}]},
        ["faults.0.agents: expected normal agents, got '4'"],
    ),
    "a clock that does two things": (
        {"faults": [{"kind": "clock", "at": 1.0, "step": 0.1, "drift": 0.1}]},
        ["faults.0: expected one of step, skew and drift"],
    ),
    "a step that lasts": (
        {"faults": [{"kind": "clock", "at": 1.0, "step": 0.1, "for": 0.1}]},
        ["faults.0.for: expected with skew and drift alone"],
    ),
    "a sensor that is silent and wrong": (
        {"faults": [{"kind": "sensor", "at": 1.0, "for": 1.0, "silent": True, "bias": {"x": 1.0}}]},
        ["faults.0: expected silent = true, or bias and noise"],
    ),
    "an unknown state": (
        {"faults": [{"kind": "sensor", "at": 1.0, "for": 1.0, "bias": {"z": 1.0}}]},
        ["faults.0.bias: expected states of agent 1, of ['x', 'y', 'theta'], got 'z'"],
    ),
    "a link of an unknown agent": (
        {"faults": [{"kind": "link", "for": 1.0, "from": "9", "loss": 1.0}]},
        ["faults.0.from: expected an agent's name or '*'"],
    ),
}


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


@pytest.mark.parametrize(("overrides", "fragments"), BROKEN.values(), ids=BROKEN)
def test_a_mistake_is_named_with_its_field(overrides, fragments):
    with pytest.raises(ScenarioError) as error:
        load("unicycles", overrides)
    for fragment in fragments:
        assert fragment in str(error.value)
