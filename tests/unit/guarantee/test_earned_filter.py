"""The reserve rule: an agent splits a pair only while its certificate outlasts a conviction."""

import numpy as np
import pytest
from msgspec.structs import replace

from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.proven_filter import EarnedFilter, ProvenFilter
from phalanx.scenario.load import ScenarioError, load
from phalanx.seeded.draws import Draws
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.safety_filter import FilterInput


def decisions(reserve: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    """Inputs near agent 2, which is trusted: split, whole, with the reserve; and seconds proven."""
    rows = build_rows(build_swarm(load("guaranteed", {"safety.information": "earned"}))).seen_by(0)
    swarm, first = rows.swarm, rows.filter(0)
    earned, agent = EarnedFilter(rows, 0, first, {1: reserve}), SwarmCertificates(swarm).of(0)
    own, other = (swarm.safe_set.parts[l] for l in (0, 1))
    draws, start, found = Draws(7, "reserve", width=4), swarm.start(), []
    for k in range(60):
        x, (far, angle, *turned) = start.copy(), draws[k].tolist()
        x[own.start + 2], x[other.start + 2] = 6.3 * np.array(turned)
        distance = 1.35 + 0.6 * far
        x[other.start] = x[own.start] + distance * np.cos(6.3 * angle)
        x[other.start + 1] = x[own.start + 1] + distance * np.sin(6.3 * angle)
        terms, towards = rows.terms(0)(x), np.array([4.0, 0.0])
        now = FilterInput(float(k), x, (0, 1, 2, 3, 4), terms, towards, {})
        trusting = replace(now, trusted=frozenset({1}))
        split, whole, made = (f.decision.u for f in (first(trusting), first(now), earned(trusting)))
        place = [swarm.safe_set.pairs[p] for p in agent.pairs].index((0, 1))
        found.append((split, whole, made, float(agent(x, split)[place])))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("reserve", [0.03, 0.06])
def test_a_pair_is_split_exactly_while_the_certificate_covers_the_reserve(reserve):
    found = decisions(reserve)
    assert any((split != whole).any() for split, whole, _, _ in found)
    covered = [proven >= reserve for *_, proven in found]
    assert 3 < sum(covered) < len(found) - 3
    for (split, whole, made, _), enough in zip(found, covered, strict=True):
        assert (made == (split if enough else whole)).all()


@pytest.mark.parametrize(("share", "trusted"), [(1.0, {1}), (1.01, set())])
def test_nobody_is_trusted_for_longer_than_the_longest_certificate(share, trusted):
    rows = build_rows(build_swarm(load("guaranteed", {"safety.information": "earned"}))).seen_by(0)
    x, asked, first = rows.swarm.start(), [], rows.filter(0)

    def observed(now):
        asked.append(now.trusted)
        return first(now)

    seen, nominal = tuple(range(5)), np.array([1.0, 0.0])
    trusting = FilterInput(0.0, x, seen, rows.terms(0)(x), nominal, {}, trusted=frozenset({1}))
    reserve = {1: share * SwarmCertificates(rows.swarm).of(0).longest}
    EarnedFilter(rows, 0, observed, reserve)(trusting)
    assert asked == [trusted]


def test_nobody_is_trusted_whose_pair_no_input_can_certify(monkeypatch):
    rows = build_rows(build_swarm(load("guaranteed", {"safety.information": "earned"}))).seen_by(0)
    x, first, asked = rows.swarm.start(), rows.filter(0), []
    of = SwarmCertificates.of

    def without_agent_2(swarm, i):
        certificates = of(swarm, i)
        certificates.provable &= certificates.others != 1
        return certificates

    monkeypatch.setattr(SwarmCertificates, "of", without_agent_2)

    def observed(now):
        asked.append(now.trusted)
        return first(now)

    trusting = FilterInput(
        0.0, x, (0, 1, 2, 3, 4), rows.terms(0)(x), np.zeros(2), {}, trusted=frozenset({1, 2})
    )
    EarnedFilter(rows, 0, observed, {1: 0.03, 2: 0.03})(trusting)
    assert asked[0] == {2}
    assert ProvenFilter(rows, 0, first)(trusting).decision.proven == 0.0


@pytest.mark.parametrize(
    ("changes", "where"),
    [({"safety.composition": "lse"}, "safety"), ({"time.latency": 0.002}, "time.latency")],
)
def test_trust_needs_pairs_and_inputs_that_apply_at_the_sample(changes, where):
    with pytest.raises(ScenarioError, match=where):
        load("guaranteed", {"safety.information": "earned", **changes})
