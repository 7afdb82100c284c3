"""Mistakes in a user's own code: each is one line with file, class, method and what to write.

It is said before any process starts.
"""

import time

import pytest

from phalanx.cli.app import USAGE_ERROR, status

MODULE = """
import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from phalanx.extend import box_polytope

@dataclass(frozen=True)
class Swimmer:
    current: float = 0.0
    states = ("x", "y", "v")
    inputs = ("a", "b")
    def drift(self, x): return ca.vertcat(ca.sin(x[1]), x[2], 0)
    def actuation(self, x): return ca.SX([[1, 0], [0, 1], [0, 0]])
    def position(self, x): return x[:2]
    def input_polytope(self, x): return box_polytope((1.0, 1.0))
    def input_metric(self): return (1.0, 1.0)

@dataclass(frozen=True)
class Unfinished:
    states, inputs, drift = ("x", "y", "v"), ("a", "b"), Swimmer.drift
    actuation, position = Swimmer.actuation, Swimmer.position
    input_polytope = Swimmer.input_polytope

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

class Plain:
    def between(self, a, b): return 1 - ca.sumsqr(a.p - b.p)
    def to_obstacle(self, a, obstacle): return obstacle.intrusion(a.p)

@dataclass(frozen=True)
class Apart(Plain): ...

class Vector(Apart):
    def between(self, a, b): return a.p - b.p

class Infinite(Apart):
    def between(self, a, b): return 1 / (a.x[2] + b.x[2])

class Branching(Apart):
    def between(self, a, b): return 1.0 if a.p[0] > b.p[0] else 2.0

class Mathematical(Apart):
    def between(self, a, b): return 1.0 - math.hypot(a.p[0] - b.p[0], a.p[1] - b.p[1])

class Selfless(Apart):
    def between(a, b): return 1 - ca.sumsqr(a.p - b.p)

@dataclass
class Rest:
    def prepare(self, dynamics): self.m = len(dynamics.inputs)
    def input(self, view): return np.zeros(self.m)

class Long(Rest):
    def input(self, view): return np.zeros(3)

class Listing(Rest):
    def input(self, view): return [1.0, 0.0]

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
    "Unfinished": ": expected a dataclass that is a Dynamics: Unfinished (mistaken.py, line 21) "
    "lacks input_metric(self), got 'mistaken:Unfinished'",
    "Swimer": "cannot be imported (AttributeError: module 'mistaken' has no attribute 'Swimer'); "
    "did you mean mistaken:Swimmer (mistaken.py)?, got 'mistaken:Swimer'",
}
FUNCTIONS = {
    "Vector": "Vector.between: expected a scalar, got shape (2,)",
    "Infinite": "Infinite.between: expected a finite h of a and b at the start, got inf",
    "Plain": "own.toml: safety.function: expected a dataclass that is a SafeSetFunction: write "
    "@dataclass above Plain (mistaken.py, line ",
    "Branching": "own: Branching.between: expected no error, got RuntimeError: Cannot compute the "
    "truth value of a CasADi SXElem symbolic expression. Use casadi's if_else in place of if (mis",
    "Mathematical": "Mathematical.between: expected a scalar made with casadi's functions, got "
    "nan: functions of math take numbers alone (mistaken.py, line ",
    "Selfless": " has between(a, b), write between(self, a, b), got 'mistaken:Selfless'",
}
LAWS = {
    "Long": "Long.input: expected a numpy array of 2 finite numbers for agent a, got shape (3,)",
    "Listing": "expected a numpy array of 2 finite numbers for agent a, got [1.0, 0.0] (mistaken.",
    "Undefined": "input: expected a numpy array of 2 finite numbers for agent a, got (nan, nan)",
    "Blind": "own: law of a: Blind.join: expected no error, got RuntimeError: no camera",
    "Enormous": "input: expected a numpy array of 2 finite numbers for agent a, got (1.7e+308, 1.7",
}
MISSPELT = {
    "agents.0.dynamics.type=mistakn:Swimmer": "agents.0.dynamics: cannot be imported "
    "(ModuleNotFoundError: No module named 'mistakn'); did you mean mistaken:Swimmer (mistaken.p",
    "agents.0.dynamics.curent=0.2": "own.toml: agents.0.dynamics.curent: unknown field: Swimmer "
    "(mistaken.py, line 10) has current, got 0.2",
}
PARTS = {"agents.0.dynamics": DYNAMICS, "safety.function": FUNCTIONS, "agents.0.law": LAWS}
MISTAKES = MISSPELT | {
    f"{part}={{ type = 'mistaken:{name}' }}": line
    for part, lines in PARTS.items()
    for name, line in lines.items()
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One folder, since a module is imported once."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "mistaken.py").write_text(MODULE)
    (folder / "own.toml").write_text(SCENARIO)
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    monkeypatch.chdir(made)
    return made


@pytest.mark.slow
@pytest.mark.parametrize(("override", "line"), MISTAKES.items(), ids=MISTAKES)
def test_a_mistake_is_one_line(folder, capsys, override, line):
    began = time.process_time()
    assert refusal(folder, capsys, "in-process", override).count(line) == 1
    assert time.process_time() - began < 2.0


# What the scenario, its rows at x(0) and a law are refused for; others come the same three ways.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "name"),
    [("agents.0.dynamics", "RowDrift"), ("safety.function", "Vector"), ("agents.0.law", "Long")],
)
def test_it_is_said_before_any_process_starts(folder, capsys, part, name):
    override = f"{part}={{ type = 'mistaken:{name}' }}"
    line = refusal(folder, capsys, "processes", override)
    assert line == refusal(folder, capsys, "in-process", override)


def refusal(folder, capsys, engine: str, override: str) -> str:
    """The one line that is said of it; nothing is made."""
    mistaken = ["--engine", engine, "--set", override]
    assert status(["run", "own.toml", *mistaken]) == USAGE_ERROR
    (line,) = capsys.readouterr().err.splitlines()
    assert not (folder / "runs").exists()
    return line


@pytest.mark.slow
def test_without_a_mistake_it_runs(folder, tmp_path):
    options = ("--engine", "in-process", "--no-report", "--out", str(tmp_path))
    assert status(["run", "own.toml", *options]) == 0
