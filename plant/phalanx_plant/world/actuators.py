"""What actuators can do: an input outside U_i(x_i) cannot be applied, whoever asks for it."""

import casadi as ca

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Polytope, constant_polytope, polytope


class Actuators:
    """The input polytopes of all agents."""

    def __init__(self, swarm: Swarm) -> None:
        different = {id(m.dynamics): m.dynamics for m in swarm.members}
        known = {key: _input_polytope(dynamics) for key, dynamics in different.items()}
        self._polytopes = [known[id(m.dynamics)] for m in swarm.members]

    def takes(self, i: int, x: Array, u: Array) -> bool:
        """Whether u, shape (m_i,), is within ACTUATION of U_i at agent i's state x, (n_i,)."""
        known = self._polytopes[i]
        if isinstance(known, CompiledFunction):
            A, b = known(x)
            known = polytope(A.reshape(len(b), -1), b)
        return known.takes(u)


def _input_polytope(dynamics: Dynamics) -> Polytope | CompiledFunction:
    """U, or the function x -> A, b where it depends on the state."""
    x = ca.SX.sym("x", len(dynamics.states))
    A, b = dynamics.input_polytope(x)
    return constant_polytope(A, b) or CompiledFunction([x], [A, b])
