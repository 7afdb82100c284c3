"""Ten mistakes of a new user: each is one line with file, class, method and what to write."""

import pytest

from phalanx.cli.app import USAGE_ERROR, status

MODULE = '''"""Classes that a new user may write."""

import math
from dataclasses import dataclass

import casadi as ca

from phalanx.extend import SingleIntegrator


@dataclass(frozen=True)
class Boat(SingleIntegrator):
    current: float = 0.1

    def drift(self, x):
        return ca.SX([self.current, 0.0])


@dataclass(frozen=True)
class Short(Boat):
    def drift(self, x):
        return ca.SX(self.current)


@dataclass(frozen=True)
class Unfinished:
    states = ("x", "y")
    inputs = ("vx", "vy")

    def drift(self, x):
        return ca.SX.zeros(2)

    def actuation(self, x):
        return ca.SX.eye(2)

    def position(self, x):
        return x

    def input_polytope(self, x):
        return ca.vertcat(ca.SX.eye(2), -ca.SX.eye(2)), ca.SX.ones(4)


class Plain:
    def between(self, a, b):
        return 1 - ca.sumsqr(a.p - b.p)

    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)


@dataclass(frozen=True)
class Branching(Plain):
    def between(self, a, b):
        return 1.0 if a.p[0] > b.p[0] else 2.0


@dataclass(frozen=True)
class Mathematical(Plain):
    def between(self, a, b):
        return 1.0 - math.hypot(a.p[0] - b.p[0], a.p[1] - b.p[1])


@dataclass(frozen=True)
class Selfless(Plain):
    def between(a, b):
        return 1 - ca.sumsqr(a.p - b.p)


@dataclass
class Listing:
    def prepare(self, dynamics):
        pass

    def input(self, view):
        return [1.0, 0.0]
'''
SCENARIO = """
name = "sea"
duration = 1.0

[safety]
function = { type = "separation", radius = 1.0 }
rho = 5.0
alpha = [5.0]
eta = 0.1

[[agents]]
names = ["red", "blue"]
role = "normal"
dynamics = { type = "sailing:Boat", speed = 2.0 }
law = { type = "track-velocity", gain = 1.0 }
clock = { period = 0.05 }
start = [[-2.0, 0.0], [2.0, 0.1]]
"""
_DYNAMICS, _FUNCTION = "sea.toml: agents.0.dynamics", "sea.toml: safety.function"
_A_FUNCTION = "expected a dataclass that is a SafeSetFunction"
MISTAKES = {
    "a wrong shape": (
        "agents.0.dynamics.type=sailing:Short",
        f"{_DYNAMICS}: Short.drift: expected shape (2,), got shape (1,) (sailing.py, line 21)",
    ),
    "a method missing": (
        "agents.0.dynamics={type='sailing:Unfinished'}",
        f"{_DYNAMICS}: expected a dataclass that is a Dynamics: Unfinished (sailing.py, line 25) "
        "lacks input_metric(self), got 'sailing:Unfinished'",
    ),
    "no dataclass": (
        "safety.function={type='sailing:Plain'}",
        f"{_FUNCTION}: {_A_FUNCTION}: write @dataclass above Plain (sailing.py, line 43), "
        "got 'sailing:Plain'",
    ),
    "a module misspelt": (
        "agents.0.dynamics.type=sialing:Boat",
        f"{_DYNAMICS}: cannot be imported (ModuleNotFoundError: No module named 'sialing'); "
        "did you mean sailing:Boat (sailing.py)?, got 'sialing:Boat'",
    ),
    "a class misspelt": (
        "agents.0.dynamics.type=sailing:Baot",
        f"{_DYNAMICS}: cannot be imported (AttributeError: module 'sailing' has no attribute "
        "'Baot'); did you mean sailing:Boat (sailing.py)?, got 'sailing:Baot'",
    ),
    "a field misspelt": (
        "agents.0.dynamics.curent=0.2",
        f"{_DYNAMICS}.curent: unknown field: Boat (sailing.py, line 11) has speed, dimension, "
        "current, got 0.2",
    ),
    "an if on an expression": (
        "safety.function={type='sailing:Branching'}",
        "sea: Branching.between: expected no error, got RuntimeError: Cannot compute the truth "
        "value of a CasADi SXElem symbolic expression. Use casadi's if_else in place of if "
        "(sailing.py, line 54)",
    ),
    "math in place of casadi": (
        "safety.function={type='sailing:Mathematical'}",
        "sea: Mathematical.between: expected a scalar made with casadi's functions, got nan: "
        "functions of math take numbers alone (sailing.py, line 59)",
    ),
    "self forgotten": (
        "safety.function={type='sailing:Selfless'}",
        f"{_FUNCTION}: {_A_FUNCTION}: Selfless (sailing.py, line 63) has between(a, b), "
        "write between(self, a, b), got 'sailing:Selfless'",
    ),
    "a list in place of an array": (
        "agents.0.law={type='sailing:Listing'}",
        "sea: Listing.input: expected a numpy array of 2 finite numbers for agent red, "
        "got [1.0, 0.0] (sailing.py, line 74)",
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder, since a module is imported once."""
    folder = tmp_path_factory.mktemp("sea")
    (folder / "sailing.py").write_text(MODULE)
    (folder / "sea.toml").write_text(SCENARIO)
    return folder


@pytest.fixture(autouse=True)
def sea(folder, monkeypatch):
    monkeypatch.chdir(folder)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_it_is_one_line_that_says_what_to_write(mistake, capsys):
    override, line = MISTAKES[mistake]
    assert status(["run", "sea.toml", "--engine", "in-process", "--set", override]) == USAGE_ERROR
    assert capsys.readouterr().err == f"{line}\n"


def test_without_a_mistake_it_runs(folder):
    assert status(["run", "sea.toml", "--engine", "in-process", "--no-report"]) == 0
