"""Attacks: an attacker that looks ahead, and a script of inputs, each from its instant on."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.laws.attacks import Script, WorstLookahead
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
    members = [Member(str(l), model, l == 0) for l, model in enumerate(dynamics)]
    law = WorstLookahead(1.0)
    law.prepare(SLOW)
    polytopes = [constant_polytope(*model.input_polytope(cast(Any, None))) for model in dynamics]
    x = {l: np.array(state) for l, state in states.items()}
    view = SimpleNamespace(i=0, x=x, normal=normal, terms=SimpleNamespace(polytopes=polytopes))
    u: list[float] = law.join(0, members, ()).input(cast(View, view)).tolist()
    return u


@pytest.mark.slow
@pytest.mark.parametrize("way", [1.0, -1.0])
@given(bearing=st.floats(0.2, 1.2), side=st.sampled_from([-1.0, 1.0]))
def test_it_turns_to_a_target_and_reverses_towards_one_behind(way, bearing, side):
    target = [way * 4.0 * np.cos(bearing), side * 4.0 * np.sin(bearing)]
    start = [0.0, 0.0, 0.0]
    assert attack({0: start, 1: target}, [1], SingleIntegrator(0.1)) == [2.0 * way, side * way]


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


gaps = st.lists(st.floats(1e-3, 10.0), max_size=6)


def at(t: float) -> View:
    """A view at a time: a script looks at nothing else."""
    return cast(View, cast(Any, SimpleNamespace(t=t)))


@given(gaps=gaps, t=st.floats(0.0, 60.0))
def test_the_last_input_that_has_begun_is_in_force(gaps, t):
    instants = tuple(np.cumsum([0.0, *gaps]).tolist())
    script = Script(instants, tuple((float(k), 0.0) for k in range(len(instants))))
    script.prepare(SingleIntegrator(10.0))
    begun = [k for k, instant in enumerate(instants) if instant <= t]
    assert script.input(at(t)).tolist() == [float(begun[-1]), 0.0]


def test_an_input_begins_at_its_instant():
    script = Script((0.0, 0.5), ((2.0, 1.0), (-2.0, 0.0)))
    script.prepare(Unicycle(2.0, 1.0))
    assert script.input(at(0.49)).tolist() == [2.0, 1.0]
    assert script.input(at(0.5)).tolist() == [-2.0, 0.0]


@pytest.mark.parametrize(
    ("instants", "inputs", "message"),
    [
        ((0.0, 1.0), ((0.0, 0.0),), "an input for each instant of at: 2, got 1"),
        ((0.5,), ((0.0, 0.0),), "expected at to begin with 0, got 0.5"),
        ((0.0, 1.0, 1.0), ((0.0, 0.0),) * 3, "expected at to ascend, got 1 after 1"),
        ((0.0,), ((2.0, 1.5),), r"inputs.0: .*nu, omega.* within U, \[-2, 2\] x \[-1, 1\], got"),
        ((0.0,), ((2.0,),), r"inputs.0: expected 2 numbers \(nu, omega\), got 1"),
    ],
)
def test_a_mistake_is_refused_with_its_place(instants, inputs, message):
    with pytest.raises(ValueError, match=message):
        Script(instants, inputs).prepare(Unicycle(2.0, 1.0))
