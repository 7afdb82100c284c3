"""A user's own dynamics, safe-set functions and laws, named "module:Name"."""

import sys
from pathlib import Path

import pytest

from phalanx.guarantee.check import check
from phalanx.scenario.load import load, read_table, scenario_text
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.dynamics import Dynamics
from tests.unit.scenario.refusals import cases, refusal
from tests.unit.tables import group, swarm_table

MODULE = """
from dataclasses import dataclass

import casadi as ca
import numpy as np

from phalanx.extend import Separation, SingleIntegrator

@dataclass(frozen=True)
class Swimmer(SingleIntegrator):
    current: float = 0.5
    def drift(self, x):
        return ca.vertcat(self.current * ca.sin(x[1]), 0)

@dataclass(frozen=True)
class Tired(Swimmer):
    def input_polytope(self, x):
        A, b = super().input_polytope(x)
        return A, b / (1 + x[0] ** 2)

@dataclass(frozen=True)
class Diamond(Separation):
    def between(self, a, b):
        return self.radius - ca.fabs(a.p[0] - b.p[0]) - ca.fabs(a.p[1] - b.p[1])

@dataclass
class Rest:
    def prepare(self, dynamics):
        pass
    def input(self, view):
        return np.zeros(2)

class Pool:
    @dataclass
    class Float(Rest):
        pass

@dataclass(frozen=True)
class Offset:
    def value(self, s):
        return s + 0.5

@dataclass(frozen=True)
class Stepped:
    def value(self, s):
        return s + ca.if_else(s > -0.25, 1.0, 0.0) - 1.0

@dataclass(frozen=True)
class Odd:  # CasADi knows it, intervals do not
    def value(self, s):
        return s + ca.fmod(s, 3.0)

A_NUMBER = 5
"""
DIAMOND = {"type": "swimming_user:Diamond", "radius": 1.0}
SAFETY = {"function": DIAMOND, "composition": "lse", "eta": 0.3, "information": "paper"}
SWIMMER = {"type": "swimming_user:Swimmer", "speed": 2.0}
AGENTS = group("a b", "normal", [[0.0, 0.0], [5.0, 0.0]], "swimming_user:Rest", dynamics=SWIMMER)
TABLE = swarm_table(AGENTS, safety=SAFETY, name="own")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a user's module and scenario, which is the working directory."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "swimming_user.py").write_text(MODULE)
    (tmp_path / "broken_user.py").write_text("import no_such_module_at_all\n")
    (tmp_path / "raising_user.py").write_text("raise RuntimeError('not today')\n")
    (tmp_path / "unparsable_user.py").write_text("def\n")
    (tmp_path / "own.toml").write_text(scenario_text(TABLE))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in ("swimming_user", "broken_user", "raising_user", "unparsable_user", "foreign_user"):
        sys.modules.pop(name, None)


def test_a_users_classes_in_the_working_directory_make_a_swarm(folder):
    scenario = load("own.toml", ["agents.0.dynamics.current=0.7"])
    swarm = build_swarm(scenario)
    dynamics = swarm.members[0].dynamics
    assert isinstance(dynamics, Dynamics)
    assert (type(dynamics).__name__, dynamics.speed, dynamics.current) == ("Swimmer", 2.0, 0.7)
    assert build_rows(swarm).chain.relative_degree == 1


def test_load_and_check_import_nothing_without_trust(folder):
    table = read_table("one-on-one")
    table["agents"][0]["law"] = {"type": "foreign_user:Law", "gain": 1.0}
    (folder / "foreign.toml").write_text(scenario_text(table))
    (folder / "foreign_user.py").write_text("from phalanx.extend import TrackVelocity as Law\n")
    for door in (load, check):
        with pytest.raises(ScenarioError, match=r"foreign_user:Law.*trust=True"):
            door("foreign.toml", trust=False)
    assert "foreign_user" not in sys.modules
    assert load("foreign.toml", trust=True).agents[0].law["type"] == "foreign_user:Law"
    assert "foreign_user" in sys.modules


@pytest.mark.slow
def test_check_takes_the_name_of_a_scenario_as_run_does():
    assert check("one-on-one").answer == check(load("one-on-one")).answer
    with pytest.raises(ScenarioError, match="did you mean 'one-on-one'"):
        check("one-on-on")


def test_a_class_within_another_is_named_by_both(folder):
    scenario = load("own.toml", ["agents.0.law.type=swimming_user:Pool.Float"])
    law = scenario.agents[0].law_object()
    assert type(law).__name__ == "Float"
    assert load("own.toml", {"agents.0.law": law}).agents[0].law == scenario.agents[0].law


BROKEN = """
agents.0.dynamics.speed=-2.0 | agents.0.dynamics.speed: expected greater than 0, got -2.0
safety.function.radius=big | safety.function.radius: expected a valid number, unable to parse
agents.0.dynamics.type=broken_user:X | agents.0.dynamics: cannot be imported (ModuleNotFoundError:
agents.0.dynamics.type=raising_user:X | cannot be imported (RuntimeError: not today
agents.0.dynamics.type=unparsable_user:X | cannot be imported (SyntaxError
agents.0.dynamics.type=:Typo | agents.0.dynamics: cannot be imported
agents.0.dynamics.type=swimming_user: | agents.0.dynamics: cannot be imported
agents.0.dynamics={type="swimming_user:A_NUMBER"} | expected a dataclass that is a Dynamics
agents.0.law={type="swimming_user:Swimmer", speed=1.0} | agents.0.law: expected a dataclass that is
safety.function={type="swimming_user:Rest"} | expected a dataclass that is a SafeSetFunction
safety.alpha=[{type="swimming_user:Offset"}] | safety.alpha.0: Offset.value: expected α(0) = 0, as
safety.alpha=[{type="swimming_user:Stepped"}] | Stepped.value: expected α without a jump at -0.25,
safety.alpha=[1, {type="swimming_user:Odd"}] | Odd.value: expected an expression that can be checked
agents.0.dynamics.type=5 | agents.0.dynamics: expected one of unicycle
"""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("override", "message"), cases(BROKEN))
def test_a_broken_class_of_a_user_is_refused_with_its_field_and_cause(override, message):
    assert message in refusal([override], "own.toml")


@pytest.mark.parametrize(
    "proven",
    [
        ["safety.composition=pairs"],
        ["safety.composition=pairs", "safety.margin=local", "safety.eta=0"],
    ],
)
def test_input_bounds_that_vary_are_refused_by_name_where_a_row_cannot_take_them(folder, proven):
    tired = "agents.0.dynamics.type=swimming_user:Tired"
    with pytest.raises(ScenarioError, match=r"input bounds of [ab]\b"):
        require_runnable(build_swarm(load("own.toml", [tired, *proven])))


@pytest.mark.slow
def test_a_check_of_varying_input_bounds_says_what_it_cannot_compute(folder):
    report = check(load("own.toml", ["agents.0.dynamics.type=swimming_user:Tired"]))
    assert report.formula is None
    assert report.largest_gap is None
    assert any("No margin can be computed" in words for words in report.words)
