"""Occurrences of faults, at given or random times, and links that a partition's shape cuts."""

import itertools

import numpy as np
import pytest

from phalanx.faults.fault import Occurrence, random_times
from phalanx.faults.links import links_between, links_cut
from phalanx.network.draws import Draws, Seeds, Tables
from phalanx.scenario.load import load

NAMES = ("1", "2", "3")


def occurrences(seed: int = 0, **fault: object) -> tuple[Occurrence, ...]:
    faults = [{"kind": "kill", "at": 0.5, "agents": ["1"]}, fault]
    return load("unicycles", {"faults": faults}, seed=seed).links().occurrences


@pytest.mark.slow
def test_random_times_have_the_given_rate_and_hit_all_agents_equally():
    rate, duration = 5.0, 400.0
    occurrences = list(random_times(rate, NAMES, duration, Tables(1, "fault", "0", width=2)))
    times = np.array([t for t, _ in occurrences])
    expected = rate * duration
    assert len(occurrences) == pytest.approx(expected, abs=4.0 * np.sqrt(expected))
    for name in NAMES:
        share = sum(hit == name for _, hit in occurrences) / len(occurrences)
        assert share == pytest.approx(1 / 3, abs=4.0 * np.sqrt(2 / 9 / len(occurrences)))
    # Of a Poisson process gaps vary by as much as they are long.
    gaps = np.diff(times)
    assert gaps.std() == pytest.approx(gaps.mean(), rel=0.1)


def test_a_longer_run_begins_with_the_same_occurrences():
    draws = Tables(1, "fault", "0", width=2)
    short, longer = (list(random_times(3.0, NAMES, duration, draws)) for duration in (4.0, 9.0))
    assert 0 < len(short) < len(longer)
    assert longer[: len(short)] == short
    always = random_times(1e3, NAMES, 0.0025, draws)
    assert [t for t, _ in always] == [0.0, 0.001, 0.002]


def test_from_a_reseed_on_occurrences_are_those_of_the_other_seed():
    seeds = Seeds(1), Seeds(1, [(2.0, 7)]), Seeds(7)
    first, changed, other = (
        [*random_times(3.0, NAMES, 4.0, Tables(seed, "fault", "0", width=2))] for seed in seeds
    )
    assert changed == [o for o in first if o[0] < 2.0] + [o for o in other if o[0] >= 2.0]
    assert first != changed != other


def test_at_a_given_time_it_hits_every_agent_once_for_its_duration():
    _, *others = occurrences(kind="pause", at=2.0, **{"for": 0.5})
    assert [(each.agent, each.begin, each.end) for each in others] == [
        (name, 2.0, 2.5) for name in "12345"
    ]


def test_an_occurrence_is_in_force_from_its_begin_and_no_longer_at_its_end():
    _, once, *_ = occurrences(kind="pause", at=2.0, **{"for": 0.5})
    assert [once.in_force(t) for t in (1.999, 2.0, 2.499, 2.5)] == [False, True, True, False]


def test_one_faults_occurrences_do_not_depend_on_anothers():
    first, *random = occurrences(kind="pause", rate=2.0, **{"for": 0.5})
    assert first == occurrences(kind="turn", at=1.0, agents=["2"])[0]
    _, *of_another_seed = occurrences(seed=1, kind="pause", rate=2.0, **{"for": 0.5})
    assert random != of_another_seed
    assert {occurrence.fault_index for occurrence in random} == {1}


AGENTS = [str(n) for n in range(1, 8)]
LINKS = set(itertools.permutations(AGENTS, 2))


def draws(seed: int = 0) -> Draws:
    return Draws(seed, "partition", "0")


def heard_by(cut, receiver: str) -> set[str]:
    return {receiver, *(s for s, r in LINKS - cut if r == receiver)}


def test_groups_receive_from_themselves_alone():
    cut = links_between([AGENTS[:3], AGENTS[3:5], AGENTS[5:]])
    for group in (AGENTS[:3], AGENTS[3:5], AGENTS[5:]):
        assert all(heard_by(cut, name) == set(group) for name in group)


def test_a_majority_is_parted_from_the_rest():
    cut = links_cut("majority", AGENTS, draws())
    groups = {frozenset(heard_by(cut, name)) for name in AGENTS}
    assert sorted(map(len, groups)) == [3, 4]


def test_one_is_isolated():
    cut = links_cut("isolate", AGENTS, draws())
    assert sorted(len(heard_by(cut, name)) for name in AGENTS) == [1] + [6] * 6


@pytest.mark.parametrize("count", [3, 5, 6, 7])
def test_in_a_ring_each_agent_receives_from_a_majority_and_no_two_from_the_same(count):
    names = AGENTS[:count]
    cut = links_cut("ring", names, draws())
    heard = [
        frozenset({r, *(s for s, other in itertools.permutations(names, 2) if other == r
                        and (s, r) not in cut)})
        for r in names
    ]  # fmt: skip
    assert {len(h) for h in heard} == {count // 2 + 1}
    assert len(set(heard)) == count


def test_the_agents_apart_are_drawn_by_the_seed():
    assert len({links_cut("isolate", AGENTS, draws(seed)) for seed in range(20)}) > 3
    assert links_cut("ring", AGENTS, draws(4)) == links_cut("ring", AGENTS, draws(4))
