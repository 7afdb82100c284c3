"""Margins of an agent's rows, in a swarm read from a scenario."""

import numpy as np
import pytest

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.integrated import IntegratedMargin
from phalanx.theory.margins.local import LocalMargin
from phalanx.theory.margins.margin import PairRow, RowPart
from tests.unit.swarms import rows_of_scenario


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
            pair = rows.own_pair(i, other)
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
