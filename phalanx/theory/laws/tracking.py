"""The laws of Simulation 2, for outputs of any degree q: track a goal, chase a target.

Both are u = K (x^d - x) + d^q/dt^q p^d, with K acting on the output and its derivatives; the
signs are those that attract (as printed in the paper they repel).
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, MinLen

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.outputs import OutputDerivatives

Positive = Annotated[float, Gt(0)]
Gains = Annotated[tuple[Positive, ...], MinLen(1)]


def output_derivatives(dynamics: Dynamics, gains: Gains) -> OutputDerivatives:
    output = OutputDerivatives(dynamics)
    if len(gains) != output.degree:
        raise ValueError(
            f"gains: {type(dynamics).__name__} needs {output.degree}, one for the output and each "
            f"of its derivatives below the input; got {len(gains)}"
        )
    return output


@dataclass
class Track:
    """K (x^d - x) + the q-th derivative of p^d: the nominal law of Simulation 2."""

    gains: Gains
    """k_1 ... k_q of the position error and its derivatives' [1/s^q ... 1/s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        self._output = output_derivatives(dynamics, self.gains)

    def input(self, view: View) -> Array:
        x = view.x[view.i]
        q, d = self._output.degree, len(view.goal.position)
        goal = np.zeros((q + 1, d))
        goal[: len(view.goal)] = view.goal[: q + 1]
        error = goal[:q] - self._output(x)
        return self._output.input_for(x, dot(error.T, np.array(self.gains)) + goal[q])
