"""The attacker that looks ahead, over all that its target may do."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.laws.attacks import WorstLookahead
from phalanx.theory.laws.law import View
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.composition import Member
from tests.unit.theory.users_own import Boosted

SLOW, FAST = Unicycle(2.0, 1.0), Unicycle(4.0, 2.0)


def attack(states: dict[int, list[float]], normal: list[int], targets: Any = FAST) -> list[float]:
    """The input of agent 0, which attacks the others, whose states are given."""
    dynamics = [SLOW, *[targets] * (max(states) or 1)]
    members = [Member(str(l), each, l == 0) for l, each in enumerate(dynamics)]
    law = WorstLookahead(1.0)
    law.prepare(SLOW)
    polytopes = [constant_polytope(*each.input_polytope(cast(Any, None))) for each in dynamics]
    x = {l: np.array(state) for l, state in states.items()}
    view = SimpleNamespace(i=0, x=x, normal=normal, terms=SimpleNamespace(polytopes=polytopes))
    found: list[float] = law.join(0, members, ()).input(cast(View, view)).tolist()
    return found


@pytest.mark.slow
@given(bearing=st.floats(0.2, 1.2), side=st.sampled_from([-1.0, 1.0]))
def test_it_drives_at_a_target_ahead_and_turns_to_its_side(bearing, side):
    there = [4.0 * np.cos(bearing), side * 4.0 * np.sin(bearing)]
    assert attack({0: [0.0, 0.0, 0.0], 1: there}, [1], SingleIntegrator(0.1)) == [2.0, side]


@pytest.mark.slow
@given(bearing=st.floats(0.2, 1.2), side=st.sampled_from([-1.0, 1.0]))
def test_it_reverses_towards_a_target_behind(bearing, side):
    there = [-4.0 * np.cos(bearing), side * 4.0 * np.sin(bearing)]
    assert attack({0: [0.0, 0.0, 0.0], 1: there}, [1], SingleIntegrator(0.1)) == [-2.0, -side]


def test_it_takes_the_target_that_it_can_come_closest_to():
    """The other is as near, but on its side: it could not turn in time."""
    slow = SingleIntegrator(0.1)
    near, far = [0.0, 3.0], [3.0, -1.0]
    assert attack({0: [0.0, 0.0, 0.0], 1: near, 2: far}, [1, 2], slow) == [2.0, -1.0]


def test_without_a_target_in_sight_it_applies_a_corner():
    assert attack({0: [0.0, 0.0, 0.0]}, []) == [-2.0, -1.0]


def test_targets_that_are_equal_but_move_otherwise_have_motions_of_their_own():
    members = [Member(str(l), Boosted(1.0, gain=g), l == 0) for l, g in enumerate((1.0, 1.0, 9.0))]
    law = WorstLookahead(1.0)
    law.prepare(members[0].dynamics)
    motions, right = law.join(0, members, ())._motions, np.array([[1.0, 0.0]])
    ends = [motions[l](np.zeros(2), right, right)[0, -1, 0] for l in (1, 2)]
    assert ends == pytest.approx([1.0, 9.0])
