"""Detours of robots that wait for one another: who goes straight on, and for how long not."""

from types import SimpleNamespace

import numpy as np
import pytest

from phalanx.theory.arrays import Array
from phalanx.theory.laws.goals import hold
from phalanx.theory.laws.law import View
from phalanx.theory.laws.unstick import Unstick


class Straight:
    """A law whose input is the way to its goal."""

    def prepare(self, dynamics: object) -> None: ...

    def input(self, view: View) -> Array:
        return view.goal.position - view.positions[view.i]


@pytest.mark.parametrize(
    ("i", "normal", "seconds"),
    [(0, (0, 1, 2), 0.0), (1, (0, 1, 2), 4.0), (2, (0, 1, 2), 6.0), (2, (1, 2), 4.0)],
)
def test_each_makes_a_detour_for_longer_the_more_normal_ones_precede_it(i, normal, seconds):
    """Three stand 1 m apart, each for longer than a second."""
    law, places = Unstick(of=Straight(), aside=2.0).join(i, (), ()), np.eye(3, 2)
    terms, goal = SimpleNamespace(positions=dict(enumerate(places))), hold(np.array([9.0, 0.0]))
    times = np.arange(0.0, 7.5, 0.5)
    inputs = [law.input(View(i, terms.positions, normal, goal, terms, t)) for t in times]
    away = [not np.array_equal(u, goal.position - places[i]) for u in inputs]
    assert away.index(True) == 2 if seconds else not any(away)
    assert sum(away[: 2 + int(2 * seconds) + 1]) == 2 * seconds
