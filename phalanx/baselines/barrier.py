"""`cbf-qp`: a control barrier function for each pair, as in continuous time.

Two normal agents keep one half of their pair's condition each, as in Wang, Ames and Egerstedt,
*Safety Barrier Certificates for Collisions-Free Multirobot Systems* (2017). Adversaries count at
their worst. What the paper adds for sampled data is left out: η, ξ, and every disturbance.
"""

from dataclasses import dataclass

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.controllers.controller import ControlledAgent, ControllerView
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows


@dataclass
class BarrierQP:
    """The input nearest to the nominal one that keeps ψ_q <= 0 of every pair at the sample."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Make the QP."""
        self._qp = NearestInput(agent.dynamics.input_metric())

    def input(self, view: ControllerView) -> Array:
        """Return the QP's input; without one, that of the least worst violation."""
        rows = barrier_rows(view)
        u = self._qp.solve(view.u_nom, view.inputs, rows)
        return least_violation(view.inputs, rows) if u is None else u


def barrier_rows(view: ControllerView) -> Rows:
    """Return a row for each pair in sight, with η = 0."""
    pairs = view.pairs
    shared = np.array([other in view.normal for other in pairs.others], dtype=np.bool_)
    return Rows(pairs.a, -np.where(shared, 0.5 * pairs.unforced, pairs.unforced + pairs.most))
