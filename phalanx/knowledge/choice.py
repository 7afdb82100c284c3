"""The input nearest to a wish among those that spend no more of any gap than they may.

Own parts are hard, whole rows yield: where no input keeps all of both, the worst whole row is
violated as little as own parts allow. Own parts are almost convex in the input; so the program's
rows are their tangents where an answer was still too much, and what then remains is left by
moving towards the brake, which spends nothing. The test of the whole hold has the last word.
"""

from typing import NamedTuple

import numpy as np

from phalanx.knowledge.cones import Cones
from phalanx.knowledge.motion import Motion
from phalanx.knowledge.spending import Pieces
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import EmptyPolytopeError, Polytope, vertices
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

_ROUNDS = 8
_STEP = 1e-5
"""Of the difference quotients of own parts, relative to the authority."""
_INSIDE = 1e-3
"""How far inside a tangent an answer is to be [m/s], so that the last one passes the test."""
_AT_MOST = 2.0 * _INSIDE
"""An own part so close to its largest keeps the input from the wish [m/s]."""
_MOVES = np.arange(1, 17) / 16.0


class Limits(NamedTuple):
    """Bounds on the own parts over the next hold."""

    cones: Cones
    """Of each peer and obstacle, n of them."""
    most: Array
    """Its largest own part towards each, shape (n,) [m/s]."""


class Chosen(NamedTuple):
    """An input of the reference, and how it came about."""

    u: Array
    braked: bool
    binding: tuple[int, ...] = ()
    """Which of the limits keep it from the wish, if any do."""


class InputChoice:
    """The choice of one agent's inputs."""

    def __init__(self, motion: Motion, pieces: Pieces) -> None:
        self._motion, self._pieces = motion, pieces
        self._qp, self._inputs = NearestInput((1.0,) * motion.axes), motion.inputs
        step = _STEP * motion.authority
        faces = np.concatenate([np.eye(motion.axes), -np.eye(motion.axes)])
        self._steps, self._width = step * faces, 2.0 * step

    def nearest(
        self,
        wish: Array,
        v: Array,
        limits: Limits | None,
        whole: Rows | None,
        turn: Array | None = None,
    ) -> Chosen:
        """Choose an input.

        Args:
            wish: shape (axes,).
            v: the reference's speed, shape (axes,).
            limits: of own parts; None if none can be too large.
            whole: rows that yield.
            turn: rotation of the set of inputs, shape (axes, axes); None for none.
        """
        inputs = self._inputs if turn is None else _turned(self._inputs, turn)
        cuts, worst = Rows(np.empty((0, len(wish))), np.empty(0)), -1
        u = self._inside(wish, inputs, cuts, whole)
        if u is None or not np.isfinite(u).all():
            return Chosen(self._motion.brake(v), True)
        if limits is None:
            return Chosen(u, False)
        for _ in range(_ROUNDS):
            around = np.concatenate([u[None], u + self._steps])
            values = self._pieces.spending(v, around, limits.cones)
            excess = values[0] - limits.most
            if (excess <= 0.0).all():
                close = {worst, *np.flatnonzero(excess >= -_AT_MOST).tolist()}
                return Chosen(u, False, tuple(sorted(close)) if worst >= 0 else ())
            worst = int(excess.argmax())
            cuts = _joined(cuts, self._tangents(u, values, excess))
            inside = self._inside(wish, inputs, cuts, whole)
            if inside is None:
                break
            u = inside
        return self._towards_brake(u, v, limits, worst)

    def _tangents(self, u: Array, values: Array, excess: Array) -> Rows:
        """Rows of the own parts that are too large, by difference quotients."""
        axes = len(u)
        slopes = ((values[1 : axes + 1] - values[axes + 1 :]) / self._width).T[excess > 0.0]
        return Rows(slopes, dot(slopes, u) - excess[excess > 0.0] - _INSIDE)

    def _inside(
        self, wish: Array, inputs: Polytope, cuts: Rows, whole: Rows | None
    ) -> Array | None:
        """The nearest input within these rows, or that which violates the whole ones least."""
        rows = cuts if whole is None else _joined(cuts, whole)
        u = self._qp.solve(wish, inputs, rows)
        if u is not None or whole is None or not len(whole.bound):
            return u
        A = np.concatenate([inputs.A, cuts.a])
        b = np.concatenate([inputs.b, cuts.bound])
        try:
            return self._qp.least_violation(Polytope(A, b, vertices(A, b), None, 0.0), whole)
        except EmptyPolytopeError:
            return None

    def _towards_brake(self, u: Array, v: Array, limits: Limits, worst: int) -> Chosen:
        """The input farthest from the brake, on the way to u, that passes the test."""
        brake = self._motion.brake(v)
        share, width = 0.0, 1.0
        for _ in range(2):
            moves = np.minimum(share + width * _MOVES, 1.0)
            tried = brake + moves[:, None] * (u - brake)
            most = self._pieces.spending(v, tried, limits.cones)
            passing = np.flatnonzero((most <= limits.most).all(axis=1))
            width /= len(_MOVES)
            if passing.size:
                share = float(moves[passing[-1]])
        u = brake + share * (u - brake) if share > 0.0 else brake
        return Chosen(u, share == 0.0, (worst,))


def _turned(inputs: Polytope, turn: Array) -> Polytope:
    """A set of inputs turned about 0, so that u becomes turn u."""
    faces, corners = (dot(points[:, None], turn) for points in (inputs.A, inputs.corners))
    return inputs._replace(A=faces, corners=corners, box=None)


def _joined(rows: Rows, more: Rows) -> Rows:
    return Rows(np.concatenate([rows.a, more.a]), np.concatenate([rows.bound, more.bound]))
