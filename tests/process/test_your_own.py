"""The example of docs/your-own.md, taken from the page as it stands."""

import re
from pathlib import Path

import pytest

import phalanx
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm

PAGE = Path(__file__).parents[2] / "docs" / "your-own.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    text = PAGE.read_text(encoding="utf-8")
    names = re.findall(r"^`(\w[^`]+)`", text, flags=re.MULTILINE)
    blocks = re.findall(r"```\w+\n(.*?)```", text, flags=re.DOTALL)
    for name, block in zip(names, blocks, strict=True):
        (tmp_path / name).write_text(block, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_of_ones_own_is_under_40_lines_and_its_relative_degree_is_found(folder):
    swarm = build_swarm(load("regatta.toml"))
    assert build_rows(swarm).chain.relative_degree == 2
    assert type(swarm.members[0].dynamics).__name__ == "Boat"
    for file in ("boats.py", "lanes.py", "pools.py"):
        assert len((folder / file).read_text().splitlines()) < 40


@pytest.mark.swarm
def test_it_runs_by_name_from_a_scenario(folder):
    summary = phalanx.run(phalanx.load("regatta.toml", {"duration": 2.0})).summary
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.origins["qp"] > 60


def test_a_limit_of_ones_own_is_a_pair_of_each_normal_agent(folder):
    limits = [{"type": "pools:Lane", "half_width": 12.0}]
    run = phalanx.run(
        phalanx.load("regatta.toml", overrides={"duration": 1.0, "limits": limits}),
        engine="in-process",
    )
    assert run.summary.outcome is Outcome.GUARANTEED
    assert run.h.columns[-2:] == ["red-limit 0", "blue-limit 0"]
    assert run.report().is_file()


REMEMBERING = """
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from phalanx.network.rule import DELIVER, DROP
from phalanx.theory.models.dynamics import box_polytope


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
@pytest.mark.parametrize("control", ["distributed", "centralised"])
def test_what_a_users_classes_remember_is_each_agents_own_in_both_engines(
    tmp_path, monkeypatch, control
):
    (tmp_path / "remembering.py").write_text(REMEMBERING)
    (tmp_path / "own.toml").write_text(REGATTA)
    monkeypatch.chdir(tmp_path)
    scenario = phalanx.load("own.toml", {"safety.control": control})
    run = phalanx.run(scenario, engine="in-process")
    assert run.verdict in (Outcome.GUARANTEED, Outcome.SAFE)
    assert run.verify(engine="processes")
    assert run.verify(engine="in-process")
