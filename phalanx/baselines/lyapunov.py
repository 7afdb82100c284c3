"""`clf-cbf`: a control Lyapunov function for the goal, and a barrier function for each pair.

As in Ames, Xu, Grizzle and Tabuada, *Control Barrier Function Based Quadratic Programs for Safety
Critical Systems* (2017), with the rows of `cbf-qp`: η = 0. The goal takes the nominal law's place.
"""

from dataclasses import dataclass
from math import comb

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.baselines.barrier import barrier_rows
from phalanx.theory.controllers.controller import ControlledAgent, ControllerView
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

_MOST = 4


@dataclass
class LyapunovBarrierQP:
    """argmin ‖u‖² + p δ² with V' <= δ - λ V and every pair's row; V = ‖s‖² / 2.

    s = (d/dt + λ)^(r-1) (p - p^d), where the inputs act on the output's r-th derivative.
    """

    rate: Positive = 2.0
    """λ [1/s]"""
    weight: Positive = 1000.0
    """p, of the slack δ."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Differentiate the output and make the QP. Raises ValueError if no input acts on it."""
        self._output, self._degree = _output(agent.dynamics)
        r = self._degree
        self._shares = np.array([comb(r - 1, k) * self.rate ** (r - 1 - k) for k in range(r)])
        self._qp = NearestInput((*agent.dynamics.input_metric(), self.weight))

    def input(self, view: ControllerView) -> Array:
        """Return the QP's input; without one, that of the least worst violation of the pairs."""
        rows = barrier_rows(view)
        a, bound = self._lyapunov_row(view)
        slack = np.zeros((len(rows.a), 1))
        both = Rows(
            np.vstack([np.hstack([rows.a, slack]), [*a, -1.0]]), np.append(rows.bound, bound)
        )
        still = np.zeros(len(a))
        if view.inputs.takes(still) and (both.bound >= 0.0).all():
            return still
        found = self._qp.solve(np.append(still, 0.0), _with_slack(view.inputs), both)
        return least_violation(view.inputs, rows) if found is None else found[:-1]

    def _lyapunov_row(self, view: ControllerView) -> tuple[Array, float]:
        """The row a u - δ <= bound of V."""
        *known, gain = self._output(view.x[view.i])
        r, axes = self._degree, len(view.goal.position)
        wanted = np.zeros((r + 1, axes))
        wanted[: len(view.goal)] = view.goal[: r + 1]
        error = np.array(known).reshape(r + 1, axes) - wanted
        s, drift = dot(error[:r].T, self._shares), dot(error[1:].T, self._shares)
        a = dot(gain.reshape(axes, -1).T, s)
        return a, -float(dot(s, drift)) - 0.5 * self.rate * float(dot(s, s))


def _output(dynamics: Dynamics) -> tuple[CompiledFunction, int]:
    """Return x -> p, p', ..., the r-th derivative without inputs, and the inputs' matrix; and r."""
    x = ca.SX.sym("x", len(dynamics.states))
    chain = [dynamics.position(x)]
    while len(chain) <= _MOST:
        slope = ca.jacobian(chain[-1], x)
        gain = slope @ dynamics.actuation(x)
        chain.append(slope @ dynamics.drift(x))
        if not gain.is_zero():
            return CompiledFunction([x], [*chain, ca.densify(gain)]), len(chain) - 1
    raise ValueError(f"clf-cbf needs an input that acts on the output's first {_MOST} derivatives")


def _with_slack(inputs: Polytope) -> Polytope:
    """U_i as a set of (u, δ), with any δ."""
    A, corners = (np.pad(each, ((0, 0), (0, 1))) for each in (inputs.A, inputs.corners))
    return Polytope(A, inputs.b, corners, None, inputs.allowance)
