"""Shipped scenarios by kinds of pairs, against the chain of the whole swarm; units of h and ψ."""

import casadi as ca
import numpy as np
import pytest
from phalanx_plant.world.evaluation import LargestPsi, LogSumExp

from phalanx.recording.curves.values import SafetyValues
from phalanx.scenario.load import load, shipped
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows
from phalanx.swarm.swarm import unit_of_psi
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import FAR
from tests.unit.swarms import rows_of_scenario
from tests.unit.theory.whole_expression import TermsFunction, in_sight

FEW = ("agents.0.count=5", "agents.1.count=1", "flows.obstacles=0.2")
"""Of a crowd: as many as make all its kinds of pairs."""

close = {"rel": 1e-12, "abs": 1e-12}


def rows_of_kinds(name: str) -> SafetyRows:
    """A shipped scenario's rows; of a crowd's, few agents."""
    return rows_of_scenario(name, *(FEW if name.startswith("swarm") else ()))


def states(rows: SafetyRows, count: int) -> np.ndarray:
    """Around the start, ever closer together, shape (count, n̄)."""
    start = rows.swarm.start()
    size = np.abs(start).max() + 2.0
    states = np.random.default_rng(5).uniform(-size, size, (count, len(start)))
    return (start + states) / (1 + np.arange(count) % 7)[:, None]


SAFE_SETS = [name for name in shipped() if not name.startswith("faults/")]
"""Faults leave the safe set as it is."""
NEAR = ("unicycles", "swarm2d", "formation3d", "formation3d-distance", "warehouse", "quadrotors")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "radius"), [*((name, None) for name in SAFE_SETS), *((name, 6.0) for name in NEAR)]
)
def test_terms_from_kinds_are_those_of_the_printed_chain(name, radius):
    rows = rows_of_kinds(name)
    swarm, safety = rows.swarm, rows.swarm.safety
    composed, i = swarm.safe_set, swarm.normal[0]
    xi = 0.0 if safety.computes_margin else safety.xi
    chain = build_chain(in_sight(composed, i, radius), safety.class_k, xi)
    reference = TermsFunction(chain, 1.5)
    terms = rows.composed.of(i, radius, 1.5)
    for x in states(rows, 12):
        distances = np.linalg.norm(swarm.positions(x) - swarm.positions(x)[i], axis=1)
        visible = np.flatnonzero(distances <= (radius or np.inf)).tolist()
        values, expected = terms(x, visible), reference(x)
        if values.psi[0] == FAR:
            continue
        assert values.psi == pytest.approx(expected.psi, **close)
        assert values.unforced == pytest.approx(expected.unforced, **close)
        for l in visible:
            assert values.c[l] == pytest.approx(expected.c[l], **close)
            assert values.least[l] == pytest.approx(expected.least[l], **close)
            assert values.most[l] == pytest.approx(expected.most[l], **close)


@pytest.mark.parametrize(
    ("name", "margin"),
    [("formation3d", "paper"), ("formation3d-distance", "local"), ("unicycles", "paper")],
)
def test_the_truths_largest_psi_is_that_of_the_chains_and_of_reports_and_viewers(name, margin):
    """Compare chains of h_tot, or of every pair alone; D_1 is within ψ_1 where it is computed."""
    rows = rows_of_scenario(name, f"safety.margin={margin}", "safety.eta=0.0")
    composed = rows.swarm.safe_set
    every = rows.swarm.pairs.every
    x, largest_psi = states(rows, 4), LargestPsi(rows)
    values = largest_psi.functions.choose(every)(x)
    total = LogSumExp(rows.swarm.safety.rho, len(every))
    higher_psi = largest_psi(x, values, np.full(4, -np.inf), total(values[..., 0]))
    if rows.relative_degree == 1:
        assert higher_psi.shape == (0,)
        return
    reported = [SafetyValues(rows).higher_psi(state).item() for state in x]
    assert higher_psi == pytest.approx(reported, rel=1e-11)
    chains = [rows.chain]
    if rows.swarm.safety.pairwise:
        chains = [rows.pair_chain(k) for k in range(len(composed.pairs))]
    largest = []
    for chain in chains:
        members = [rows.swarm.names.index(m.name) for m in chain.set.members]
        indices = np.concatenate([np.r_[composed.parts[l]] for l in members])
        psi = ca.Function("psi", [chain.set.x], [chain.set.substitute(chain.psi[1])])
        largest.append([float(psi(state[indices])) for state in x])
    assert higher_psi == pytest.approx(np.max(largest, axis=0), rel=1e-11)


def test_what_must_not_be_above_zero_is_every_pairs_or_every_agents_own():
    pairs = rows_of_scenario("formation3d-distance")
    x = pairs.swarm.start()
    assert len(pairs.invariants()(x)) == 2 * len(pairs.swarm.safe_set.pairs)
    limited = rows_of_scenario("formation3d")
    psi = limited.invariants()(x).reshape(4, 2)
    for row, i in enumerate(limited.swarm.normal):
        in_sight = limited.swarm.seen(i, x)
        assert psi[row].tolist() == limited.terms(i)(x, in_sight).psi.tolist()
    assert len(rows_of_scenario("unicycles").invariants()(limited.swarm.start()[:15])) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["guaranteed", "swarm", "formation3d"])
def test_forked_programs_have_nothing_left_to_compile(name, monkeypatch):
    """But memory for as many pairs as they see."""
    rows = SafetyRows(rows_of_kinds(name).swarm, rows_of_kinds(name).composed)
    compile_rows(rows)
    monkeypatch.setattr(rows.__class__, "own_pair", None)
    if not rows.swarm.safety.pairwise:
        assert all("jets" in vars(kind) for kind in rows.swarm.pairs.kinds)
        return
    x = rows.swarm.start()
    for i in rows.swarm.normal:
        for sharing in ((), rows.swarm.normal):
            assert len(rows.pair_terms(i)(x, sharing=sharing).others)


@pytest.mark.slow
def test_agents_of_one_group_share_what_is_compiled():
    rows = rows_of_kinds("swarm")
    x = rows.swarm.start()
    for i in rows.swarm.normal:
        for part in (RowPart.WHOLE, RowPart.HALF):
            rows.pair_terms(i)(x, sharing=rows.swarm.normal if part is RowPart.HALF else ())
    # Normal on either side, whole and half; adversary; sphere.
    assert sum(key[0] == "row" for key in rows.swarm.functions.results) == 6
    assert len(rows.swarm.pairs.every) == len(rows.swarm.safe_set.pairs)


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("formation3d", ("m²", "m²/s", "m²/s²", "m²/s³")),
        ("formation3d-distance", ("m", "m/s", "m/s²", "m/s³")),
        ("fence", ("m", "m/s", "m/s²", "m/s³")),
    ],
)
def test_psi_is_h_for_each_second_as_often_as_it_was_differentiated(name, units):
    assert tuple(unit_of_psi(load(name), k) for k in range(4)) == units


def test_a_limit_in_another_unit_leaves_none_that_all_have():
    disc = "limits=[{ type = 'fence', center = [0.0, 0.0], radius = 90.0 }]"
    assert unit_of_psi(load("unicycles"), 1) == "m²/s"
    assert unit_of_psi(load("unicycles", [disc]), 1) == ""
