"""What actuators can do: an input outside U_i(x_i) cannot be applied, whoever asks for it."""

import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import constant_polytope, polytope
from phalanx.wire.messages import Actuation, Sample

Array = NDArray[np.float64]


class Actuators:
    """The input polytopes of all agents."""

    def __init__(self, swarm: Swarm) -> None:
        composed = swarm.safe_set
        symbolic = [
            m.dynamics.input_polytope(composed.x[part])
            for m, part in zip(swarm.members, composed.parts, strict=True)
        ]
        self._constant = [constant_polytope(A, b) for A, b in symbolic]
        self._varying = [CompiledFunction([composed.x], Ab) for Ab in symbolic]

    def admissible(self, i: int, sample: Sample, message: Actuation) -> bool:
        """Whether agent i's input is within ACTUATION of U_i at the state it was sampled at."""
        return self.takes(i, np.frombuffer(sample.x, dtype="<f8"), np.array(message.u))

    def takes(self, i: int, x: Array, u: Array) -> bool:
        """Whether u, shape (m_i,), is within ACTUATION of U_i at the stacked state x, (n̄,)."""
        known = self._constant[i]
        if known is None:
            A, b = self._varying[i](x)
            known = polytope(A.reshape(len(b), -1), b)
        return bool((dot(known.A, u) <= known.b + known.allowance).all())
