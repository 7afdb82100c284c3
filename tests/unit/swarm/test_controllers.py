"""Controllers in place of the paper's filter: what they see, and what their mistakes say."""

from dataclasses import dataclass
from pathlib import Path

import pytest

import phalanx
from phalanx.cli.app import USAGE_ERROR, status
from phalanx.report.write import key_figures
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.theory.baselines.controllers import Escape
from phalanx.theory.rows.origin import Origin
from tests.layers import layered

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Hoard(Escape):
    """Has a field that no scenario can hold."""

    weights: object = None


MODULE = '''"""Controllers that a new user may write."""

import time
from dataclasses import dataclass

import numpy as np

@dataclass
class Held:
    """Keeps a part of its last input: it has a state."""
    keep: float = 0.5
    def prepare(self, agent):
        self.last = np.zeros(len(agent.dynamics.inputs))
    def input(self, view):
        self.last = self.keep * self.last + (1.0 - self.keep) * view.u_nom
        return self.last

@dataclass
class Long(Held):
    def input(self, view):
        return np.zeros(3)

@dataclass
class Choosy(Held):
    def prepare(self, agent):
        raise ValueError("it wants three inputs")

@dataclass
class Unready(Held):
    def prepare(self, agent):
        self.gain = agent.gain

@dataclass
class Mute:
    def prepare(self, agent):
        pass

@dataclass
class Late(Held):
    def input(self, view):
        if view.t > 0.2:
            return None
        return view.u_nom

@dataclass
class Endless(Held):
    def input(self, view):
        while True:
            time.sleep(0.001)

@dataclass
class Looking(Held):
    """Writes down what it sees."""
    def input(self, view):
        seen.append((view, view.certified(view.u_nom)))
        return view.u_nom

@dataclass
class Noting(Held):
    def input(self, view):
        view.note(wish=view.u_nom[0], early=view.t < 0.1)
        if view.t < 0.1:
            view.note(wish=-1.0)
        else:
            view.note(late=1)
        return view.u_nom

@dataclass
class Unbounded(Held):
    def input(self, view):
        view.note(gap=float("nan"))

@dataclass
class Chatty(Held):
    def input(self, view):
        view.note(**{f"n{k}": k for k in range(33)})

@dataclass
class LongWinded(Held):
    def input(self, view):
        view.note(**{"n" * 41: 0.0})

seen = []
'''
MISTAKES = {
    "Long": "Long.input: expected a numpy array of 2 finite numbers for agent 1, got shape (3,)",
    "Choosy": "controller of 1: it wants three inputs",
    "Unready": "got AttributeError: 'ControlledAgent' object has no attribute 'gain' (keeping.py",
    "Unbounded": "got ValueError: note: expected a finite number, got gap = nan (keeping.py",
    "Chatty": "got ValueError: note: expected at most 32, got 33 (keeping.py",
    "LongWinded": "got ValueError: note: expected at most 40 ASCII letters, got nnn",
    "Mute": "Mute (keeping.py, line 33) lacks input(self, view)",
    "Endless": "got an endless loop, or too slow (keeping.py",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("controllers")
    (made / "keeping.py").write_text(MODULE, encoding="utf-8")
    return made


@pytest.fixture(autouse=True)
def beside_the_module(folder, monkeypatch):
    monkeypatch.chdir(folder)


def run(controller, scenario="one-on-one", **overrides):
    table = {"type": controller} if isinstance(controller, str) else controller
    settings = {"agents.0.controller": table, "duration": 0.5, **overrides}
    return phalanx.run(load(scenario, settings), engine="in-process")


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name, capsys):
    options = ["--set", f"agents.0.controller={{ type = 'keeping:{name}' }}"]
    options += ["--set", "time.timeout=0.5", "--engine", "in-process", "--no-report"]
    assert status(["run", "unicycles", *options]) == USAGE_ERROR
    (line,) = capsys.readouterr().err.splitlines()
    assert MISTAKES[name] in line


def test_a_tenth_mistake_comes_late_and_names_agent_and_sample():
    found = run("keeping:Late").summary
    assert found.outcome == "broken"
    assert "at sample 20: Late.input: expected a numpy array of" in found.reason
    assert "keeping.py, line" in found.reason


def test_a_controller_is_for_normal_agents_under_distributed_control():
    with pytest.raises(ScenarioError, match=r"controller: expected none for adversaries"):
        load("unicycles", {"agents.1.controller": {"type": "none"}})
    with pytest.raises(ScenarioError, match=r"agents.0.controller: expected none: with safety.con"):
        load("unicycles", {"agents.0.controller.type": "none", "safety.control": "centralised"})


@pytest.mark.slow
def test_a_controller_with_a_state_begins_again_in_every_run():
    kept = {"type": "keeping:Held", "keep": 0.9}
    first, second = (run(kept, "unicycles").summary.trajectory for _ in range(2))
    assert first == second
    assert first != run("keeping:Held", "unicycles").summary.trajectory


def test_an_object_stands_for_its_class_and_fields(folder, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    from keeping import Held

    by_object = load("unicycles", {"agents.0.controller": Held(keep=0.9)})
    by_table = load("unicycles", {"agents.0.controller": {"type": "keeping:Held", "keep": 0.9}})
    assert by_object.agents == by_table.agents
    assert "keeping:Held" in by_object.reading.command(0)
    short = load("unicycles", {"agents.0.controller": Escape()})
    assert short.agents[0].controller == {"type": "escape"}


def test_an_object_that_cannot_be_named_is_refused():
    @dataclass(frozen=True)
    class Hidden(Escape):
        weights: object = None

    with pytest.raises(ScenarioError, match=r"^agents.0.controller: expected a class that has a"):
        load("unicycles", {"agents.0.controller": Hidden()})
    with pytest.raises(ScenarioError, match=r"^x: expected numbers, .* in Hoard.weights, .*object"):
        load("unicycles", {"x": Hoard(object())})
    session = {"type": "__main__:Filter"}
    scenario = load("unicycles")
    group = scenario.agents[0].model_copy(update={"controller": session})
    scenario = scenario.model_copy(update={"agents": (group, *scenario.agents[1:])})
    with pytest.raises(phalanx.EngineError, match=r"^__main__:Filter is of this script or noteb"):
        phalanx.run(scenario, engine="processes")


def test_its_inputs_count_as_its_own_and_no_row_is_claimed():
    summary = run("none").summary
    origins = {Origin(name): count for name, count in summary.origins.items() if count}
    assert set(origins) <= {Origin.CONTROLLER, Origin.PROJECTED}
    assert "non-empty K_i" not in {each.name for each in summary.theorem}
    assert "controller" not in run("none", **{"agents.0.controller": None}).summary.origins


def test_a_report_claims_no_empty_k_for_it():
    found = run("none", "unicycles")
    figures = dict(key_figures(found.recording))
    assert figures["Empty K_i"].endswith("steps by another controller, which has no K_i")
    assert "normal steps" not in figures["Empty K_i"]


@pytest.mark.slow
def test_inputs_outside_its_polytope_are_projected_and_counted():
    inputs = run("none", "unicycles").inputs
    projected = inputs.filter(inputs["origin"] == Origin.PROJECTED)
    assert len(projected)
    nominal, applied = projected["nominal.omega"].abs(), projected["u.omega"].abs()
    assert (nominal > 2.0).all()
    assert (applied == 2.0).all()


def test_what_it_asks_for_is_the_certificate_of_the_verdict():
    scenario = load("unicycles", {"agents.0.controller.type": "keeping:Looking", "duration": 0.1})
    inputs = phalanx.run(scenario, engine="in-process").inputs
    import keeping

    asked_inputs = {(str(view.i + 1), view.t): found for view, found in keeping.seen}
    for row in inputs.filter(inputs["origin"] == Origin.CONTROLLER).iter_rows(named=True):
        assert asked_inputs[row["agent"], row["t"]] == row["certified"]


@pytest.mark.slow
def test_what_it_notes_is_in_the_inputs():
    inputs = run("keeping:Noting", "unicycles").inputs
    noted = [name for name in inputs.columns if name.startswith("note.")]
    assert noted == ["note.early", "note.late", "note.wish"]
    early, late, other = (
        inputs.filter(which)
        for which in (
            (inputs["origin"] != Origin.ATTACK) & (inputs["t"] < 0.1),
            (inputs["origin"] != Origin.ATTACK) & (inputs["t"] >= 0.1),
            inputs["origin"] == Origin.ATTACK,
        )
    )
    assert set(early["note.wish"]) == {-1.0}
    assert early["note.late"].is_null().all()
    assert late["note.wish"].to_list() == late["nominal.nu"].to_list()
    assert set(late["note.early"]) == {0.0}
    assert other.select(noted).null_count().sum_horizontal().item() == 3 * len(other) > 0


@pytest.mark.slow
def test_a_check_names_the_agents_that_decide_by_themselves():
    found = phalanx.check(load("unicycles", {"agents.0.controller.type": "escape"}))
    assert found.may_be_guaranteed
    assert found.rows_at_start == {}
    assert any("decides for 1, 2, 3" in gap for gap in found.gaps)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["none", "cbf-qp", "clf-cbf", "escape"])
@pytest.mark.parametrize(
    "scenario",
    layered(("unicycles", "formation3d", "swarm2d", "faults/loss"), ("unicycles", "swarm2d")),
)
def test_every_baseline_runs_on(scenario, name):
    assert run(name, scenario, duration=0.2).summary.outcome != "broken"


def test_the_page_has_the_example_that_was_compared():
    page, source = (
        (ROOT / name).read_text(encoding="utf-8")
        for name in ("docs/your-controller.md", "evidence/controllers/shield.py")
    )
    assert source.partition('"""\n\n')[2] in page
