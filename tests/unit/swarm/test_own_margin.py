"""Margins of an agent's rows in a swarm read from a scenario, and a margin of one's own."""

import numpy as np
import pytest

from phalanx.guarantee.check import check
from phalanx.scenario.load import load, scenario_text
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.integrated import IntegratedMargin
from phalanx.theory.margins.local import LocalMargin
from phalanx.theory.margins.margin import PairRow, RowPart
from tests.unit.swarms import rows_of_scenario
from tests.unit.tables import SPLIT, group, swarm_table

MODULE = """
from dataclasses import dataclass

import casadi as ca

from phalanx.extend import LocalMargin, PairRow

@dataclass(frozen=True)
class Reserve:
    speed: float
    def at_sample(self, row: PairRow):
        steepness = ca.norm_2(row.chain.actuation[row.own])
        return row.share * row.horizon * self.speed * steepness + row.bounds[1 - row.own]

class Pair(Reserve):
    def at_sample(self, row): return ca.vertcat(1, 2)

class Foreign(Reserve):
    def at_sample(self, row): return ca.SX.sym("wind")

class Infinite(Reserve):
    def at_sample(self, row): return 1 / ca.sumsqr(row.chain.set.x[1])

@dataclass(frozen=True)
class Absent:
    speed: float

@dataclass(frozen=True)
class Subclass(LocalMargin):
    speed: float = 0.0
"""

AGENTS = group(
    "a b",
    "normal",
    [[-2.0, 0.0], [2.0, 0.0]],
    clock={"period": 0.05, "jitter": 0.01},
    disturbance={"bound": 0.25},
)
MARGIN = {"alpha": [5.0], "margin": {"type": "reserves:Reserve", "speed": 2.0}}
TABLE = swarm_table(AGENTS, safety=SPLIT | MARGIN, name="own", duration=0.1)
MISTAKES = {
    "Pair": "own: Pair.at_sample: expected a scalar, got shape (2,) (reserves.py, line ",
    "Foreign": "own: Foreign.at_sample: expected an expression of its arguments alone, got one",
    "Infinite": "own: Infinite.at_sample: expected a finite margin of a and b at the start, got no",
    "Absent": "own.toml: safety.margin: expected a dataclass that is a Margin: Absent (res",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder, since a module is imported once."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "reserves.py").write_text(MODULE)
    (folder / "own.toml").write_text(scenario_text(TABLE))
    return folder


@pytest.fixture(autouse=True)
def in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)


def test_it_is_what_a_pairs_row_keeps_back():
    rows = require_runnable(build_swarm(load("own.toml")))
    x, steepness = rows.swarm.start(), 2.0 * 4.0  # ∂h/∂x = -2 (x_a - x_b)
    for i in (0, 1):
        for sharing, share in (((), 1.0), (rows.swarm.normal, 0.5)):
            (value,) = rows.pair_terms(i)(x, sharing=sharing).margin
            assert value == pytest.approx(share * 0.06 * 2.0 * steepness + 0.25)


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_it_is_one_line(name):
    with pytest.raises(ScenarioError) as error:
        require_runnable(build_swarm(load("own.toml", {"safety.margin.type": f"reserves:{name}"})))
    assert str(error.value).startswith(MISTAKES[name])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("safety.composition=lse", "safety.margin: expected 'paper', or composition = 'pairs'"),
        ("safety.eta=1.0", "safety.eta: expected no value, or 0: margin = 'reserves:Reserve'"),
        ("safety.margin=locale", "safety.margin: expected one of paper, corrected, local, integr"),
        ("safety.margin=5", "safety.margin: expected a valid string, got 5"),
    ],
)
def test_a_choice_that_does_not_fit_is_named(override, line):
    with pytest.raises(ScenarioError) as error:
        load("own.toml", [override])
    assert str(error.value).startswith(f"own.toml: {line}")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Reserve", "Subclass"])
def test_a_check_claims_no_proof_for_it(name):
    scenario = load("own.toml", {"safety.margin.type": f"reserves:{name}"})
    report = check(scenario)
    (gap,) = report.gaps
    assert gap.startswith(f"nothing proves that the margin reserves:{name} is a bound")
    rows = [row for row in report.table if row.name.startswith("margin")]
    assert [(row.value, row.holds) for row in rows] == [(f"by reserves:{name}", None)]


def test_a_table_of_a_built_in_name_is_that_name():
    table = load("own.toml", {"safety.margin": {"type": "local"}}).safety
    assert table.margin == "local"
    assert table.bounds_margin
    x = np.array([-2.0, 0.0, 2.0, 0.0])
    scenarios = [load("own.toml", {"safety.margin": m}) for m in ("local", {"type": "local"})]
    a, b = (require_runnable(build_swarm(s)).pair_terms(0)(x).margin for s in scenarios)
    assert a.tolist() == b.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "margin"), [("local", LocalMargin()), ("integrated", IntegratedMargin())]
)
def test_an_agents_rows_have_the_margin_of_its_own_place_until_it_samples_again(kind, margin):
    """Γ_i + δ_i^max and the latency: for so long its input may be in force."""
    late = ["time.latency=0.003", "agents.0.clock.jitter=0.001", f"safety.margin={kind}"]
    rows = rows_of_scenario("guaranteed", *late)
    swarm = rows.swarm
    x = swarm.start()
    bounds = [group.disturbance.bound for group in swarm.groups]
    for i in (swarm.normal[0], swarm.normal[-1]):  # of their pairs either end
        clock = swarm.groups[i].clock
        horizon = clock.period + 0.001 + 0.003
        whole = rows.pair_terms(i)(x)
        terms = rows.pair_terms(i)(x, sharing=swarm.normal)
        present = [o for o in terms.others if o < 5]
        assert sorted(present) == [l for l in range(5) if l != i]
        for k, other in enumerate(terms.others):
            if other >= 5:
                continue
            pair = rows.own_pair(i, other, plain=False)
            members = [swarm.names.index(m.name) for m in pair.chain.set.members]
            assert members[pair.side] == i
            parts = {RowPart.WHOLE: whole.margin[whole.others.index(other)]}
            parts[RowPart.HALF if terms.half[k] else RowPart.WHOLE] = terms.margin[k]
            assert (RowPart.HALF in parts) == (other in swarm.normal)
            phi = [bounds[l] for l in members]
            for part, value in parts.items():
                row = PairRow(pair.chain, pair.side, part, horizon, tuple(phi))
                expression = margin.at_sample(row)
                state = np.concatenate([x[swarm.safe_set.parts[l]] for l in members])
                expected = CompiledFunction([pair.chain.set.x], [expression])(state)[0]
                assert value == pytest.approx(expected[0])


def test_for_q_1_the_corrected_margin_is_the_papers_and_for_q_2_no_disturbance_counts_twice():
    pairs, margins = "safety.composition=pairs", ("paper", "corrected")
    same = [rows_of_scenario("unicycles", pairs, f"safety.margin={m}") for m in margins]
    x = same[0].swarm.start()
    paper, corrected = (rows.pair_terms(0)(x).margin for rows in same)
    assert paper == pytest.approx(8.0566)
    assert (paper == corrected).all()
    eta = "safety.eta={c_f=0.0, c_g=0.0, c_alpha=0.0, c_gamma=0.0, c_h=9.0, u_max=1.0, mu=1.0}"
    assert rows_of_scenario("unicycles", eta).margin(0).eta == pytest.approx(9.0 * 5 * 1.73)
    assert rows_of_scenario("formation3d", eta).margin(0).eta == 0.0
