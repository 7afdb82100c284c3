"""The centralised QP of Theorem 1, Eq. (QPmultiple): all normal agents' inputs at once."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Box, Polytope, minimiser
from phalanx.theory.rows.decision import Decision, backup, finite_or_none, require_numbers
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Row, Terms
from phalanx.theory.safety.composition import stacked_slices


class JointInput:
    """argmin ‖u_N - u_nom‖² over U_N with Σ_N c_i u_i <= -(unforced + Σ_A max c_j u + η)."""

    def __init__(self, dynamics: Sequence[Dynamics]) -> None:
        """dynamics: of the normal agents, in order."""
        self._parts = stacked_slices([len(d.inputs) for d in dynamics])
        shapes = [d.input_polytope(ca.SX.sym("x", len(d.states)))[0].shape[0] for d in dynamics]
        metric = tuple(weight for d in dynamics for weight in d.input_metric())
        self._rows = stacked_slices(shapes)
        self._qp = NearestInput(metric)
        self._alone = [NearestInput(d.input_metric()) for d in dynamics]

    def decide(self, terms: Terms, normal: Sequence[int], u_nom: Sequence[Array]) -> list[Decision]:
        """Every normal agent's input; where K is empty, every agent's own u_i^min.

        Args:
            terms: at the common sample.
            normal: the normal agents, in the order of their dynamics.
            u_nom: their nominal inputs, shapes (m_i,).
        """
        row = joint_row(terms, normal)
        least = added(terms.least[l] for l in normal)
        if least > row.bound:
            empty = finite_or_none(least - row.bound), finite_or_none(terms.margin)
            agents = zip(normal, u_nom, self._alone, strict=True)
            return [Decision(*backup(terms, l, u, qp), *empty) for l, u, qp in agents]
        origin = Origin.QP
        u = self._qp.solve(np.concatenate(u_nom), self._joint(terms, normal), row)
        if u is None:
            require_numbers(least, row.bound)
            backups = [minimiser(terms.c[l], terms.polytopes[l].corners) for l in normal]
            u, origin = np.concatenate(backups), Origin.SOLVER_FAILED
        residual = float(dot(row.a, u) - row.bound)
        return [Decision(u[part], origin, residual, terms.margin) for part in self._parts]

    def _joint(self, terms: Terms, normal: Sequence[int]) -> Polytope:
        """U_N, the product of the U_i, without its many corners, which are not needed."""
        polytopes = [terms.polytopes[l] for l in normal]
        A = np.zeros((self._rows[-1].stop, self._parts[-1].stop))
        for rows, part, polytope in zip(self._rows, self._parts, polytopes, strict=True):
            A[rows, part] = polytope.A
        boxes = [polytope.box for polytope in polytopes if polytope.box is not None]
        box, allowance = None, min(polytope.allowance for polytope in polytopes)
        if len(boxes) == len(polytopes):
            low, high = [box.low for box in boxes], [box.high for box in boxes]
            box = Box(np.concatenate(low), np.concatenate(high))
        return Polytope(
            A,
            np.concatenate([polytope.b for polytope in polytopes]),
            np.zeros((0, A.shape[1])),
            box,
            allowance,
        )


def joint_row(terms: Terms, normal: Sequence[int]) -> Row:
    """The condition of Eq. (KNx) on all normal agents' inputs, stacked."""
    attack = added(most for l, most in terms.most.items() if l not in normal)
    return Row(
        np.concatenate([terms.c[l] for l in normal]), -(terms.unforced + attack + terms.margin)
    )
