"""The strongest informed attacker of pairs: it looks ahead, over all that its target may do."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.obstacles import Obstacle

_STEPS = 20
"""Instants of each horizon at which the distance counts."""
_FIRST = _STEPS // 4
"""Steps for which the attacker holds a corner."""


@dataclass
class WorstLookahead:
    """The corner of U_j that brings it closest to a normal agent which escapes as well as it can.

    It holds the corner for a quarter of the horizon, and then a mean of two corners. Its target
    knows that, and holds the best mean of two of its own corners. At each sample it decides
    again, so that the input is bang-bang. Of all targets in sight it takes the one that it can come
    closest to; if it sees none it applies the first corner.
    """

    horizon: Positive = 3.0
    """[s]"""

    def prepare(self, dynamics: Dynamics) -> None:
        """Make room for the motions of the swarm's members."""
        self._motions: Mapping[int, _Motion] = {}

    def join(
        self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]
    ) -> "WorstLookahead":
        """The law of agent i in a swarm."""
        joined, motions = copy(self), dict[int, _Motion]()
        for l, member in enumerate(members):
            if l == i or not member.adversary:
                same = (each for each in motions.values() if each.dynamics == member.dynamics)
                motions[l] = next(same, None) or _Motion(member.dynamics, self.horizon)
        joined._motions = motions
        return joined

    def input(self, view: View) -> Array:
        corners, later = _choices(view, view.i)
        targets = [l for l in view.normal if l != view.i]
        if not targets:
            first_corner: Array = corners[0]
            return first_corner
        first, then = np.repeat(corners, len(later), axis=0), np.tile(later, (len(corners), 1))
        own = self._motions[view.i](view.x[view.i], first, then)
        closest = [self._closest(view, l, own) for l in targets]
        best: Array = corners[int(np.argmin(np.min(closest, axis=0))) // len(later)]
        return best

    def _closest(self, view: View, l: int, own: Array) -> Array:
        """Distance that target l can keep from each of one's own paths [m]."""
        _, held = _choices(view, l)
        paths = self._motions[l](view.x[l], held, held)
        apart = own[:, None] - paths
        squares: Array = dot(apart, apart).min(axis=2).max(axis=1)
        return squares


def _choices(view: View, l: int) -> tuple[Array, Array]:
    """The corners of agent l's U, and all means of two of them, shapes (v, m) and (c, m)."""
    corners = view.terms.polytopes[l].corners
    means = 0.5 * (corners[:, None] + corners)
    return corners, np.unique(means.reshape(-1, corners.shape[1]), axis=0)


class _Motion:
    """Positions of an agent that holds one input and then another, without disturbance."""

    def __init__(self, dynamics: Dynamics, horizon: float) -> None:
        self.dynamics = dynamics
        start = ca.SX.sym("x", len(dynamics.states))
        first, then = (ca.SX.sym(name, len(dynamics.inputs)) for name in ("first", "then"))
        x, positions, step = start, [], horizon / _STEPS
        for number in range(_STEPS):
            u = first if number < _FIRST else then
            middle = x + 0.5 * step * (dynamics.drift(x) + dynamics.actuation(x) @ u)
            x = x + step * (dynamics.drift(middle) + dynamics.actuation(middle) @ u)
            positions.append(dynamics.position(x).T)
        self._positions = MappedFunction([start, first, then], [ca.vertcat(*positions)])

    def __call__(self, x: Array, first: Array, then: Array) -> Array:
        """Positions from state x, shape (n,), for each pair of inputs, shape (r, steps, d)."""
        rows = np.column_stack([np.broadcast_to(x, (len(first), len(x))), first, then])
        found = self._positions(rows.ravel(), np.arange(rows.size).reshape(rows.shape))
        return found.reshape(len(first), _STEPS, -1)
