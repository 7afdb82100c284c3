"""The example of docs/your-own.md, taken from the page as it stands."""

import re
from pathlib import Path

import pytest

import phalanx
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from tests.layers import layered
from tests.unit.tables import group, swarm_table

PAGE = Path(__file__).parents[2] / "docs" / "your-own.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    text = PAGE.read_text(encoding="utf-8")
    files = re.findall(r"^`([\w.]+)`[^\n]*\n\n```\w+\n(.*?)```", text, re.DOTALL | re.MULTILINE)
    assert [name for name, _ in files] == ["boats.py", "lanes.py", "regatta.toml"]
    for name, block in files:
        (tmp_path / name).write_text(block, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_of_ones_own_is_under_40_lines_and_its_relative_degree_is_found(folder):
    swarm = build_swarm(load("regatta.toml"))
    assert build_rows(swarm).chain.relative_degree == 2
    assert type(swarm.members[0].dynamics).__name__ == "Boat"
    for file in ("boats.py", "lanes.py"):
        assert len((folder / file).read_text().splitlines()) < 40


@pytest.mark.swarm
def test_it_runs_by_name_from_a_scenario(folder):
    summary = phalanx.run(phalanx.load("regatta.toml", {"duration": 2.0})).summary
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.origins["qp"] > 60


REMEMBERING = """
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from phalanx.extend import DELIVER, DROP, box_polytope

@dataclass
class Sum:
    value: float = 0.0
    def __hash__(self):
        return id(self)

@dataclass
class Integral:
    \"\"\"Remembers in each way there is: in what prepare and __post_init__ make, in fields, in
    defaults, in its class, and in the dynamics that it was shown.\"\"\"
    gain: float
    sum: Any = Sum()
    errors: list[float] = field(default_factory=list)
    inputs = 0
    last = {}
    def __post_init__(self):
        self.total = np.zeros(2)
    def prepare(self, dynamics):
        self.dynamics = dynamics
    def input(self, view):
        error = -view.positions[view.i]
        self.total += 0.01 * error
        self.sum.value += 0.001 * float(error[0])
        self.errors.append(0.001 * float(error[1]))
        type(self).inputs += 1
        self.last["x"] = self.last.get("x", 0.0) + 0.001
        self.dynamics.asked += 1
        more = self.sum.value + sum(self.errors) + self.last["x"]
        return error + self.gain * self.total + more + 0.0001 * (self.inputs + self.dynamics.asked)

@dataclass
class Third:
    \"\"\"Drops every third message that it was asked about.\"\"\"
    asked: int = 0
    def treat(self, message):
        self.asked += 1
        return DROP if self.asked % 3 == 0 else DELIVER

@dataclass
class Steeper:
    \"\"\"Each time that it is asked.\"\"\"
    gain: float
    asked: int = 0
    def value(self, s):
        self.asked += 1
        return self.gain * self.asked * s

@dataclass
class Farther:
    radius: float
    asked: int = 0
    def between(self, a, b):
        self.asked += 1
        return (self.radius + 0.01 * self.asked) ** 2 - ca.sumsqr(a.p - b.p)
    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)

@dataclass
class Drifting:
    asked: int = 0
    states = ("x", "y")
    inputs = ("vx", "vy")
    def drift(self, x):
        self.asked += 1
        return ca.SX([0.01 * self.asked, 0.0])
    def actuation(self, x):
        return ca.SX.eye(2)
    def position(self, x):
        return x
    def input_polytope(self, x):
        return box_polytope((2.0, 2.0))
    def input_metric(self):
        return (1.0, 1.0)
"""
REGATTA = """
name = "remembering"
duration = 1.5

[safety]
function = { type = "remembering:Farther", radius = 1.0 }
rho = 5.0
alpha = [{ type = "remembering:Steeper", gain = 2.0 }]
eta = 0.1

[network]
rules = [{ type = "remembering:Third" }]
sample = { rules = [{ type = "remembering:Third" }] }

[[faults]]
kind = "restart"
agents = ["b"]
at = 0.5
for = 0.3

[[agents]]
names = ["a", "b", "c"]
role = "normal"
dynamics = { type = "remembering:Drifting" }
law = { type = "remembering:Integral", gain = 0.5 }
clock = { period = 0.05, jitter = 0.01 }
start = [[-2.0, 0.0], [2.0, 0.1], [0.0, 2.5]]
"""


@pytest.mark.swarm
@pytest.mark.parametrize(
    ("control", "composition"), [("distributed", "pairs"), ("centralised", "lse")]
)
def test_what_a_users_classes_remember_is_each_agents_own_in_both_engines(
    tmp_path, monkeypatch, control, composition
):
    (tmp_path / "remembering.py").write_text(REMEMBERING)
    (tmp_path / "own.toml").write_text(REGATTA)
    monkeypatch.chdir(tmp_path)
    safety = {"safety.control": control, "safety.composition": composition}
    scenario = phalanx.load("own.toml", safety)
    run = phalanx.run(scenario, engine="in-process")
    assert run.verdict in (Outcome.GUARANTEED, Outcome.SAFE)
    assert phalanx.verify(run, engine="processes")
    assert phalanx.verify(run, engine="in-process")


FAILING = """
from dataclasses import dataclass

import casadi as ca
import numpy as np

from phalanx.extend import DELIVER, box_polytope

def fail(how):
    match how:
        case "raises":
            return 1 / 0
        case "hangs":
            while True:
                pass
    return np.array([np.nan, 0.0]) if how == "nan" else None

@dataclass
class Sail:
    how: str
    asked: int = 0
    def prepare(self, dynamics):
        self.agents = 0
    def input(self, view):
        self.asked += 1
        if self.asked <= 10 or view.i != 0:
            return np.zeros(2)
        return fail(self.how)

@dataclass
class Rain:
    how: str
    first: int = 5
    def treat(self, message):
        return DELIVER if message.k < self.first else fail(self.how)

@dataclass(frozen=True)
class Boat:
    how: str  # beyond x = -2.1 this method has no value
    states = ("x", "y")
    inputs = ("vx", "vy")
    def root(self, how, x):
        return 0.001 * ca.sqrt(x[0] + 2.1) if self.how == how else 0.0
    def drift(self, x):
        return ca.vertcat(self.root("drift", x), 0.0)
    def actuation(self, x):
        return ca.SX.eye(2)
    def position(self, x):
        return ca.vertcat(x[0] + self.root("position", x), x[1])
    def input_polytope(self, x):
        A, b = box_polytope((2.0, 2.0))
        return A, b + self.root("polytope", x)
    def input_metric(self):
        return (1.0, 1.0)

@dataclass(frozen=True)
class Apart:
    how: str  # beyond x = -2.1 it has no value, or no slope
    def between(self, a, b):
        inside = a.p[0] + 2.1
        root = ca.sqrt(inside if self.how == "value" else ca.fmax(inside, 0.0))
        return 1.0 - ca.sumsqr(a.p - b.p) + 0.001 * root
    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)

@dataclass
class Left:
    def prepare(self, dynamics):
        pass
    def input(self, view):
        return np.array([-1.0, 0.0])

@dataclass(frozen=True)
class Reserve:
    def at_sample(self, row):
        return 0.001 * ca.sqrt(row.chain.set.x[0] + 2.1)
"""
CALM = swarm_table(
    group(
        "red blue",
        "normal",
        [[-2.0, 0.0], [2.0, 0.1]],
        law={"type": "failing:Sail", "how": "fine"},
        clock={"period": 0.05, "jitter": 0.01},
    ),
    safety={"alpha": [2.0], "composition": "lse", "eta": 0.1, "information": "paper"},
    name="calm",
    duration=2.0,
)
_BY_RED = "agent red failed at sample 10: Sail.input: expected "
LAWS = {
    "nan": f"{_BY_RED}a numpy array of 2 finite numbers for agent red, got (nan, 0) (failing.py, ",
    "raises": f"{_BY_RED}no error for agent red, got ZeroDivisionError: division by zero (failing.",
    "hangs": f"{_BY_RED}no error for agent red, got an endless loop, or too slow (failing.py, ",
}
_RULE = "rule rules.0 failed at message 5 from red to blue: Rain.treat: expected "
_BY_BLUE = f"agent blue failed at sample 5: {_RULE}"
RULES = {
    "nothing": f"{_BY_BLUE}DELIVER, DROP, or a tuple of copies that arrive after sending, got None",
    "hangs": f"{_BY_BLUE}no error, got an endless loop, or too slow (failing.py, line ",
}


@pytest.fixture(scope="module")
def failing(tmp_path_factory):
    """One folder, since a module is imported once."""
    folder = tmp_path_factory.mktemp("failing")
    (folder / "failing.py").write_text(FAILING)
    return folder


@pytest.fixture
def calm(failing, monkeypatch):
    monkeypatch.chdir(failing)


def broken_as(words: str, overrides: dict, engine: str) -> None:
    # With processes the agent is to say so before the plant gives it up, on a busy machine too.
    timeout = 2.0 if engine == "in-process" else 20.0
    scenario = phalanx.load(CALM, {**overrides, "time.timeout": timeout})
    run = phalanx.run(scenario, engine=engine)
    assert run.verdict is Outcome.BROKEN
    quoting = r"(agent \w+ failed; it says: ['\"])?"
    assert re.match(quoting + re.escape(words), run.summary.reason)
    assert run.recording.damage is None
    assert run.recording.summary.reason == run.summary.reason


@pytest.mark.swarm
@pytest.mark.parametrize(
    ("how", "engine"), [*((how, "in-process") for how in LAWS), ("nan", "processes")]
)
def test_a_law_that_fails_in_a_run_ends_it_at_once_by_name(calm, how, engine):
    broken_as(LAWS[how], {"agents.0.law.how": how}, engine)


@pytest.mark.swarm
@pytest.mark.parametrize(
    ("how", "engine"), [*((how, "in-process") for how in RULES), ("nothing", "processes")]
)
def test_a_rule_that_fails_in_a_run_ends_it_at_once_by_name(calm, how, engine):
    rule = {"type": "failing:Rain", "how": how}
    broken_as(RULES[how], {"network.rules": [rule]}, engine)


def test_a_rule_within_a_robot_that_does_not_return_ends_the_run_too(calm):
    rules = [{"type": "failing:Rain", "how": "hangs"}]
    words = "a robot's own link: rule rules.0 failed at message 5 from "
    broken_as(words, {"network.sample.rules": rules}, "in-process")


@pytest.mark.parametrize("link", ["network", "network.sample", "network.actuation", "faults"])
def test_a_users_rule_is_asked_before_the_run(calm, link):
    rules = [{"type": "failing:Rain", "how": "nothing", "first": 0}]
    fault = {"kind": "link", "at": 1.9, "for": 0.1, "from": "blue", "rules": rules}
    overrides = {"faults": [fault]} if link == "faults" else {f"{link}.rules": rules}
    expected = r"at message 0 from .*Rain\.treat: .* got None"
    with pytest.raises(phalanx.ScenarioError, match=expected):
        phalanx.run(phalanx.load(CALM, overrides), engine="in-process")


_AT_3 = "agent red failed at sample 3: "
NO_NUMBERS = {
    "drift": "the state of agent red is no longer finite at t = 0.102 s: check Boat.drift (failing."
    "py, line ",
    "position": "the output point of agent red is no longer finite at t = 0.102 s: check "
    "Boat.position (failing.py, line ",
    "polytope": f"{_AT_3}Boat.input_polytope: expected finite numbers at x = (-2.139, 0), got (",
    "margin": f"{_AT_3}Reserve.at_sample: expected a finite margin of red and blue, got no finite ",
    "slope": f"{_AT_3}Apart.between: expected a finite h of red and blue, and finite derivatives, "
    "got an h without finite derivatives (failing.py, line ",
}


@pytest.mark.swarm
@pytest.mark.parametrize("engine", layered(("in-process", "processes"), ("in-process",)))
@pytest.mark.parametrize("how", NO_NUMBERS)
def test_an_expression_that_has_no_value_in_a_run_ends_it_by_name(calm, how, engine):
    overrides = {
        "agents.0.law": {"type": "failing:Left"},
        "agents.0.dynamics": {"type": "failing:Boat", "how": how},
    }
    if how == "slope":
        overrides["safety.function"] = {"type": "failing:Apart", "how": how}
    if how == "margin":
        margin = {"type": "failing:Reserve"}
        overrides |= {"safety.margin": margin, "safety.eta": 0.0, "safety.composition": "pairs"}
    broken_as(NO_NUMBERS[how], overrides, engine)


@pytest.mark.parametrize("setting", ["safety.composition=pairs", "safety.control=centralised"])
def test_it_does_so_whatever_keeps_the_row(calm, setting):
    overrides = ["agents.0.law={ type = 'failing:Left' }", "agents.0.clock={ period = 0.05 }"]
    function = "safety.function={ type = 'failing:Apart', how = 'slope' }"
    run = phalanx.run(phalanx.load(CALM, [*overrides, function, setting]), engine="in-process")
    assert ": Apart.between: expected a finite h of red and blue" in run.summary.reason


@pytest.mark.swarm
@pytest.mark.parametrize("engine", ["in-process", "processes"])
def test_an_h_that_has_no_value_in_a_run_ends_it_by_name(calm, engine):
    """The plant or an agent may be the first to see it."""
    function = {"type": "failing:Apart", "how": "value"}
    overrides = {"agents.0.law": {"type": "failing:Left"}, "safety.function": function}
    run = phalanx.run(phalanx.load(CALM, overrides), engine=engine)
    assert run.verdict is Outcome.BROKEN
    assert re.search(
        r"red.*Apart\.between(: expected .* got nan)? \(failing\.py, line ", run.summary.reason
    )
