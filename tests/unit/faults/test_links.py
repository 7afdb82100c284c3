"""Links that each shape of a partition cuts."""

import itertools

import pytest

from phalanx.faults.links import links_between, links_cut
from phalanx.network.draws import Draws

NAMES = [str(n) for n in range(1, 8)]
LINKS = set(itertools.permutations(NAMES, 2))


def draws(seed: int = 0) -> Draws:
    return Draws(seed, "partition", "0")


def heard_by(cut, receiver: str) -> set[str]:
    return {receiver, *(s for s, r in LINKS - cut if r == receiver)}


def test_groups_receive_from_themselves_alone():
    cut = links_between([NAMES[:3], NAMES[3:5], NAMES[5:]])
    for group in (NAMES[:3], NAMES[3:5], NAMES[5:]):
        assert all(heard_by(cut, name) == set(group) for name in group)


def test_a_majority_is_parted_from_the_rest():
    cut = links_cut("majority", NAMES, draws())
    groups = {frozenset(heard_by(cut, name)) for name in NAMES}
    assert sorted(map(len, groups)) == [3, 4]


def test_one_is_isolated():
    cut = links_cut("isolate", NAMES, draws())
    assert sorted(len(heard_by(cut, name)) for name in NAMES) == [1] + [6] * 6


@pytest.mark.parametrize("count", [3, 5, 6, 7])
def test_in_a_ring_each_agent_receives_from_a_majority_and_no_two_from_the_same(count):
    names = NAMES[:count]
    cut = links_cut("ring", names, draws())
    heard = [
        frozenset({r, *(s for s, other in itertools.permutations(names, 2) if other == r
                        and (s, r) not in cut)})
        for r in names
    ]  # fmt: skip
    assert {len(h) for h in heard} == {count // 2 + 1}
    assert len(set(heard)) == count


def test_the_agents_apart_are_drawn_by_the_seed():
    assert len({links_cut("isolate", NAMES, draws(seed)) for seed in range(20)}) > 3
    assert links_cut("ring", NAMES, draws(4)) == links_cut("ring", NAMES, draws(4))
