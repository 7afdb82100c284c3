"""What actuators can do: an input outside U_i(x_i) cannot be applied, whoever asks for it."""

import numpy as np

from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import constant_polytope
from phalanx.wire.messages import Actuation, Sample

_TOLERANCE = 1e-5


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
        """Whether agent i's input lies in U_i at the state it was sampled at."""
        known = self._constant[i]
        if known is not None:
            A, b = known.A, known.b
        else:
            A, b = self._varying[i](np.frombuffer(sample.x, dtype="<f8"))
            A = A.reshape(len(b), -1)
        return bool((dot(A, np.array(message.u)) <= b + _TOLERANCE).all())
