"""Mistakes in a user's own code: each is one line, and said before any process starts."""

import sys
import time

import pytest

from phalanx.cli.app import USAGE_ERROR, status

MODULE = """
from dataclasses import dataclass

import casadi as ca
import numpy as np

from phalanx.extend import box_polytope


@dataclass(frozen=True)
class Swimmer:
    states = ("x", "y", "v")
    inputs = ("a", "b")

    def drift(self, x): return ca.vertcat(ca.sin(x[1]), x[2], 0)
    def actuation(self, x): return ca.SX([[1, 0], [0, 1], [0, 0]])
    def position(self, x): return x[:2]
    def input_polytope(self, x): return box_polytope((1.0, 1.0))
    def input_metric(self): return (1.0, 1.0)


class TextStates(Swimmer): states = "xyv"
class TwinStates(Swimmer): states = ("x", "y", "y")
class NoInputs(Swimmer): inputs = ()

class RowDrift(Swimmer):
    def drift(self, x): return ca.horzcat(x[1], x[2], 0)

class ForeignDrift(Swimmer):
    def drift(self, x): return ca.vertcat(ca.SX.sym("wind"), 0, 0)

class SingularDrift(Swimmer):
    def drift(self, x): return ca.vertcat(1 / x[2], 0, 0)

class TransposedActuation(Swimmer):
    def actuation(self, x): return ca.SX([[1, 0, 0], [0, 1, 0]])

class FlatPosition(Swimmer):
    def position(self, x): return x[0]

class HalfPolytope(Swimmer):
    def input_polytope(self, x): return ca.SX.eye(2)

class NarrowPolytope(Swimmer):
    def input_polytope(self, x): return ca.SX([[1], [-1]]), ca.SX([1, 1])

class OpenPolytope(Swimmer):
    def input_polytope(self, x): return ca.SX.eye(2), ca.SX([1, 1])

class EmptyAtStart(Swimmer):
    def input_polytope(self, x):
        A, b = box_polytope((1.0, 1.0))
        return A, b * (x[0] - 100)

class ShortMetric(Swimmer):
    def input_metric(self): return (1.0,)

class ZeroMetric(Swimmer):
    def input_metric(self): return (1.0, 0.0)

class BackwardTravel(Swimmer):
    def travel(self, x, time, disturbance): return -1.0

class Unmakable(Swimmer):
    def __post_init__(self): {}["wheel"]


@dataclass(frozen=True)
class Apart:
    def between(self, a, b): return 1 - ca.sumsqr(a.p - b.p)
    def to_obstacle(self, a, obstacle): return obstacle.intrusion(a.p)

class Vector(Apart):
    def between(self, a, b): return a.p - b.p

class Infinite(Apart):
    def between(self, a, b): return 1 / (a.x[2] + b.x[2])


@dataclass
class Rest:
    def prepare(self, dynamics): self.m = len(dynamics.inputs)
    def input(self, view): return np.zeros(self.m)

class Long(Rest):
    def input(self, view): return np.zeros(3)

class Undefined(Rest):
    def input(self, view): return np.full(self.m, np.nan)

class Enormous(Rest):
    def input(self, view): return np.full(self.m, 1.7e308)

class Blind(Rest):
    def join(self, i, members, obstacles): raise RuntimeError("no camera")
"""

SCENARIO = """
name = "own"
duration = 1.0

[safety]
function = { type = "mistaken:Apart" }
rho = 5.0
alpha = [1.0]
eta = 0.1

[[obstacles]]
center = [9.0, 9.0]
clearance = 1.0

[[agents]]
names = ["a", "b"]
role = "normal"
dynamics = { type = "mistaken:Swimmer" }
law = { type = "mistaken:Rest" }
clock = { period = 0.01 }
start = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
"""

DYNAMICS = {
    "TextStates": "TextStates.states: expected a tuple of different names, got 'xyv'",
    "TwinStates": "TwinStates.states: expected a tuple of different names, got ('x', 'y', 'y')",
    "NoInputs": "NoInputs.inputs: expected a tuple of different names, got ()",
    "RowDrift": "RowDrift.drift: expected shape (3,), got shape (1, 3)",
    "ForeignDrift": "drift: expected an expression of its arguments alone, got one of wind too",
    "SingularDrift": "SingularDrift.drift: expected finite numbers at the start x = (0, 0, 0), got "
    "(inf, 0, 0)",
    "TransposedActuation": "actuation: expected shape (3, 2), got shape (2, 3)",
    "FlatPosition": "FlatPosition.position: expected shape (2,) or shape (3,), got shape (1,)",
    "HalfPolytope": "input_polytope: expected A(x) of shape (r, 2) and b(x) of shape (r,), got SX",
    "NarrowPolytope": "NarrowPolytope.input_polytope: expected shape (2, 2), got shape (2,)",
    "OpenPolytope": "input_polytope: expected a compact set that is not empty, got {u : A u <= b}",
    "EmptyAtStart": "EmptyAtStart.input_polytope: expected a compact set that is not empty at the "
    "start x = (0, 0, 0), got no point",
    "ShortMetric": "ShortMetric.input_metric: expected 2 weights above 0, got (1.0,)",
    "ZeroMetric": "ZeroMetric.input_metric: expected 2 weights above 0, got (1.0, 0.0)",
    "BackwardTravel": "BackwardTravel.travel: expected a distance [m], got -1.0",
    "Unmakable": "expected mistaken:Unmakable to be made of its fields, got KeyError: 'wheel'",
}
FUNCTIONS = {
    "Vector": "Vector.between: expected a scalar, got shape (2,)",
    "Infinite": "Infinite.between: expected a finite h of a and b at the start, got inf",
}
LAWS = {
    "Long": "Long.input: expected a numpy array of 2 finite numbers for agent a, got shape (3,)",
    "Undefined": "input: expected a numpy array of 2 finite numbers for agent a, got (nan, nan)",
    "Blind": "own: law of a: Blind.join: expected no error, got RuntimeError: no camera",
    "Enormous": "input: expected a numpy array of 2 finite numbers for agent a, got (1.7e+308, 1.7",
}
MISTAKES = [
    *[("agents.0.dynamics.type", *mistake) for mistake in DYNAMICS.items()],
    *[("safety.function.type", *mistake) for mistake in FUNCTIONS.items()],
    *[("agents.0.law.type", *mistake) for mistake in LAWS.items()],
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "mistaken.py").write_text(MODULE)
    (tmp_path / "own.toml").write_text(SCENARIO)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("mistaken", None)


@pytest.mark.slow
@pytest.mark.parametrize(("field", "name", "line"), MISTAKES, ids=[m[1] for m in MISTAKES])
def test_a_mistake_is_one_line(folder, capsys, field, name, line):
    began = time.process_time()
    assert refusal(folder, capsys, "in-process", field, name).count(line) == 1
    assert time.process_time() - began < 2.0


# What the scenario, its rows at x(0) and a law are refused for; others come the same three ways.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["RowDrift", "Vector", "Long"])
def test_it_is_said_before_any_process_starts(folder, capsys, name):
    (field,) = (field for field, mistake, _ in MISTAKES if mistake == name)
    line = refusal(folder, capsys, "processes", field, name)
    assert line == refusal(folder, capsys, "in-process", field, name)


def refusal(folder, capsys, engine: str, field: str, name: str) -> str:
    """The one line that is said of it; nothing is made."""
    mistaken = ["--engine", engine, "--set", f"{field}=mistaken:{name}"]
    assert status(["run", "own.toml", *mistaken]) == USAGE_ERROR
    (line,) = capsys.readouterr().err.splitlines()
    assert not (folder / "runs").exists()
    return line


@pytest.mark.slow
def test_without_a_mistake_it_runs(folder):
    assert status(["run", "own.toml", "--engine", "in-process", "--no-report"]) == 0
