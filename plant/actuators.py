"""What actuators can do: an input outside U_i(x_i) cannot be applied, whoever asks for it."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import constant_polytope, polytope

Array = NDArray[np.float64]


class Actuators:
    """The input polytopes of all agents."""

    def __init__(self, swarm: Swarm) -> None:
        states = [ca.SX.sym("x", len(m.dynamics.states)) for m in swarm.members]
        symbolic = [
            m.dynamics.input_polytope(x) for m, x in zip(swarm.members, states, strict=True)
        ]
        self._constant = [constant_polytope(A, b) for A, b in symbolic]
        self._varying = [
            CompiledFunction([x], Ab) if known is None else None
            for x, Ab, known in zip(states, symbolic, self._constant, strict=True)
        ]

    def takes(self, i: int, x: Array, u: Array) -> bool:
        """Whether u, shape (m_i,), is within ACTUATION of U_i at agent i's state x, (n_i,)."""
        known, varying = self._constant[i], self._varying[i]
        if known is None:
            assert varying is not None
            A, b = varying(x)
            known = polytope(A.reshape(len(b), -1), b)
        return bool((dot(known.A, u) <= known.b + known.allowance).all())
