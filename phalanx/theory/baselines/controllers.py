"""Controllers to compare with: `none`, `escape`, `cbf-qp` and `clf-cbf`.

The last two have a control barrier function for each pair, as in continuous time. Two normal agents
keep one half of their pair's condition each, as in Wang, Ames and Egerstedt, *Safety Barrier
Certificates for Collisions-Free Multirobot Systems* (2017). Adversaries count at their worst. What
the paper adds for sampled data is left out: η, ξ, and every disturbance. `clf-cbf` has a control
Lyapunov function for the goal too, in the nominal law's place, as in Ames, Xu, Grizzle and Tabuada,
*Control Barrier Function Based Quadratic Programs for Safety Critical Systems* (2017).
"""

from dataclasses import dataclass
from math import comb

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import ControlledAgent, ControllerView
from phalanx.theory.laws.tracking import output_chain
from phalanx.theory.models.polytope import Polytope, minimiser
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

_RATE = 2.0
"""λ [1/s]: an error falls to a tenth in 1.2 s, if inputs and pairs allow it."""
_SLACK_WEIGHT = 1000.0
"""p: large beside the weights of inputs, so that V falls as it should unless a pair forbids it."""


@dataclass(frozen=True)
class Nominal:
    """The nominal input, clipped to what the actuators take.

    >>> isinstance(Nominal(), Controller)
    True
    """

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return u_nom; the run projects it onto U_i."""
        return view.u_nom


@dataclass(frozen=True)
class Escape:
    """Flight from whatever is nearest, by the pair with the largest h.

    >>> isinstance(Escape(), Controller)
    True
    """

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return the corner of U_i that lowers ψ_q of that pair most; u_nom if none is in sight."""
        pairs = view.pairs
        if not len(pairs.psi):
            return view.u_nom
        return minimiser(pairs.a[pairs.psi[:, 0].argmax()], view.inputs.corners)


@dataclass
class BarrierQP:
    """The input nearest to the nominal one that keeps ψ_q <= 0 of every pair at the sample.

    >>> isinstance(BarrierQP(), Controller)
    True
    """

    def prepare(self, agent: ControlledAgent) -> None:
        """Make the QP."""
        self._qp = NearestInput(agent.dynamics.input_metric())

    def input(self, view: ControllerView) -> Array:
        """Return the QP's input; without one, that of the least worst violation."""
        rows = barrier_rows(view)
        u = self._qp.solve(view.u_nom, view.inputs, rows)
        return self._qp.least_violation(view.inputs, rows) if u is None else u


def barrier_rows(view: ControllerView) -> Rows:
    """Return a row for each pair in sight, with η = 0."""
    pairs = view.pairs
    shared = np.array([other in view.normal for other in pairs.others], dtype=np.bool_)
    return Rows(pairs.a, -np.where(shared, 0.5 * pairs.unforced, pairs.unforced + pairs.most))


@dataclass
class LyapunovBarrierQP:
    """argmin ‖u‖² + p δ² with V' <= δ - λ V and every pair's row; V = ‖s‖² / 2.

    s = (d/dt + λ)^(r-1) (p - p^d), where the inputs act on the output's r-th derivative.

    >>> isinstance(LyapunovBarrierQP(), Controller)
    True
    """

    def prepare(self, agent: ControlledAgent) -> None:
        """Differentiate the output and make the QP. Raises ValueError if no input acts on it."""
        chain = output_chain(agent.dynamics)
        gain = ca.densify(chain.decoupling)
        self._output = CompiledFunction([chain.x], [*chain.derivatives, gain])
        self._degree = r = chain.degree
        self._shares = np.array([comb(r - 1, k) * _RATE ** (r - 1 - k) for k in range(r)])
        self._qp = NearestInput((*agent.dynamics.input_metric(), _SLACK_WEIGHT))

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
        solution = self._qp.solve(np.append(still, 0.0), _with_slack(view.inputs), both)
        return self._qp.least_violation(view.inputs, rows) if solution is None else solution[:-1]

    def _lyapunov_row(self, view: ControllerView) -> tuple[Array, float]:
        """The row a u - δ <= bound of V."""
        *derivatives, gain = self._output(view.x[view.i])
        r, axes = self._degree, len(view.goal.position)
        reference = np.zeros((r + 1, axes))
        reference[: len(view.goal)] = view.goal[: r + 1]
        error = np.array(derivatives).reshape(r + 1, axes) - reference
        s, drift = dot(error[:r].T, self._shares), dot(error[1:].T, self._shares)
        a = dot(gain.reshape(axes, -1).T, s)
        return a, -float(dot(s, drift)) - 0.5 * _RATE * float(dot(s, s))


def _with_slack(inputs: Polytope) -> Polytope:
    """U_i as a set of (u, δ), with any δ."""
    A, corners = (np.pad(matrix, ((0, 0), (0, 1))) for matrix in (inputs.A, inputs.corners))
    return Polytope(A, inputs.b, corners, None, inputs.allowance)
