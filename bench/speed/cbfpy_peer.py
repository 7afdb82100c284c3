"""Agent i's problem for cbfpy: the same h_tot, class-K gains, margin and bounds, written in JAX.

cbfpy supports one agent and no adversary. So it receives the inputs of all other agents, which
Phalanx computes itself: û_l, and the input w_j that attains γ_j^max.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.rows.row import Terms
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere


class Peer:
    """cbfpy's safety filter of one agent."""

    def __init__(self, rows: SafetyRows, i: int, backend: str) -> None:
        """backend: "qpax" or "elastiqp"."""
        self._problem = Problem(rows, i, backend)
        self._filter = CBF.from_config(self._problem)
        self._constants = (rows.margin(i).eta, rows.swarm.safety.xi_of_chain or 0.0)

    def __call__(self, x: Array, u_nom: Array, push: Array, active: Array) -> Array:
        """Return the nearest input, shape (m_i,).

        Args:
            x: stacked state, shape (n̄,).
            u_nom: nominal input, shape (m_i,).
            push: Σ_{l≠i} g_l w_l, shape (n̄,).
            active: 1 for pairs in the neighbourhood, else 0, shape (p,).
        """
        u = self._filter.safety_filter(x, u_nom, push, active, *self._constants)
        return np.asarray(u)


class Problem(CBFConfig):  # type: ignore[misc]
    """h = -h_tot of Simulation 1 (q = 1) or 2 (q = 2), safe at or above 0."""

    def __init__(self, rows: SafetyRows, i: int, backend: str) -> None:
        swarm = rows.swarm
        composed, self._i = swarm.safe_set, i
        self._degree = rows.relative_degree
        self._alphas = [a.gain for a in swarm.safety.class_k if isinstance(a, Linear)]
        self._rho = swarm.safety.rho
        self._dynamics = swarm.members[i].dynamics
        self._shape = len(swarm.members), len(self._dynamics.states)
        self._a = np.array([p.a for p in composed.pairs])
        agents = len(composed.members)
        self._b = np.array([p.b for p in composed.pairs if p.b < agents])
        spheres = [o for o in composed.obstacles if isinstance(o, Sphere)]
        around = [spheres[p.b - agents] for p in composed.pairs if p.b >= agents]
        self._centers = np.array([o.center for o in around])
        function = swarm.safety.safe_set_function
        assert isinstance(function, Separation)
        self._radii = np.array([function.radius] * len(self._b) + [o.clearance for o in around])
        limit, _ = _limits(self._dynamics)
        super().__init__(
            n=self._shape[0] * self._shape[1],
            m=len(limit),
            u_min=-limit,
            u_max=limit,
            relax_qp=backend == "elastiqp",
            # elastiqp has soft rows only; softer ones are violated if the row's normal is small.
            cbf_relaxation_penalty=1e6,
            control_relaxation_penalty=1e6,
            solver_tol=1e-6,
            backend=backend,
            init_args=(np.zeros(self._shape[0] * self._shape[1]), np.ones(len(self._a)), 0.0, 0.0),
        )

    def f(self, z: Any, push: Any, *_: Any) -> Any:
        """Return the drift plus the effect of all other agents' inputs."""
        if isinstance(self._dynamics, Unicycle):
            return jnp.asarray(push)
        v = z.reshape(self._shape)[:, 3:]
        return jnp.hstack([v, -_drag(self._dynamics) * v]).ravel() + push

    def g(self, z: Any, *_: Any) -> Any:
        """Return the actuation matrix of agent i alone."""
        first = self._i * self._shape[1]
        g = jnp.zeros((self.n, self.m))
        if isinstance(self._dynamics, Unicycle):
            theta = z[first + 2]
            column = jnp.array([jnp.cos(theta), jnp.sin(theta)])
            return g.at[first : first + 2, 0].set(column).at[first + 2, 1].set(1.0)
        return g.at[first + 3 : first + 6].set(jnp.eye(3))

    def h_1(self, z: Any, push: Any, active: Any, *_: Any) -> Any:
        """Return -h_tot if q = 1."""
        return self._h(z, active) if self._degree == 1 else jnp.zeros(0)

    def h_2(self, z: Any, push: Any, active: Any, *_: Any) -> Any:
        """Return -h_tot if q = 2."""
        return self._h(z, active) if self._degree == 2 else jnp.zeros(0)

    def alpha(self, h: Any, push: Any, active: Any, eta: Any, xi: Any) -> Any:
        """Return α_q less the margin."""
        return self._alphas[-1] * h - eta

    def alpha_2(self, h_2: Any, push: Any, active: Any, eta: Any, xi: Any) -> Any:
        """Return α_1 less ξ."""
        return self._alphas[0] * h_2 - xi

    def P(self, z: Any, u_des: Any, *_: Any) -> Any:  # noqa: N802
        """Return the QP's metric."""
        return jnp.diag(2.0 * jnp.array(self._dynamics.input_metric()))

    def q(self, z: Any, u_des: Any, *_: Any) -> Any:
        """Return the QP's linear term, towards the nominal input."""
        return -2.0 * jnp.array(self._dynamics.input_metric()) * u_des

    def _h(self, z: Any, active: Any) -> Any:
        states = z.reshape(self._shape)
        if isinstance(self._dynamics, Unicycle):
            heading = jnp.stack([jnp.cos(states[:, 2]), jnp.sin(states[:, 2])], axis=1)
            p = states[:, :2] + self._dynamics.offset * heading
        else:
            p = states[:, :3]
        others = jnp.concatenate([p[self._b], self._centers])
        h = self._radii**2 - jnp.sum((p[self._a] - others) ** 2, axis=1)
        return -jax.nn.logsumexp(self._rho * h, b=active, keepdims=True) / self._rho


def push(swarm: Swarm, i: int, terms: Terms, heard: dict[int, Array], x: Array) -> Array:
    """Return Σ_{l≠i} g_l w_l, shape (n̄,): w_l = û_l if received, else attains γ_l^max."""
    total = np.zeros(len(x))
    for l, (member, part) in enumerate(zip(swarm.members, swarm.safe_set.parts, strict=True)):
        if l == i or l not in terms.c:  # agents that are not seen do not count
            continue
        _, actuation = _limits(member.dynamics)
        corners = terms.polytopes[l].corners
        worst = corners[int(np.argmax(corners @ terms.c[l]))]
        total[part] = actuation(x[part]) @ heard.get(l, worst)
    return total


def _limits(dynamics: Any) -> tuple[Array, Any]:
    """Return the limit of the box |u| <= limit, and g as a function of the member's state."""
    if isinstance(dynamics, Unicycle):
        turn = np.array([0.0, 0.0, 1.0])
        return np.array([dynamics.speed, dynamics.turn_rate]), lambda x: np.column_stack(
            [[np.cos(x[2]), np.sin(x[2]), 0.0], turn]
        )
    assert isinstance(dynamics, DoubleIntegrator)
    g = np.vstack([np.zeros((3, 3)), np.eye(3)])
    return np.full(3, dynamics.acceleration), lambda _: g


def _drag(dynamics: Any) -> float:
    assert isinstance(dynamics, DoubleIntegrator)
    return dynamics.drag
