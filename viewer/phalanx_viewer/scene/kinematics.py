"""Poses of a stacked state, effects of inputs on them, and directions and rotations in space."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.composition import ComposedSet, stacked_slices

_HEADING_STATES = ("theta", "psi", "yaw", "heading")


@dataclass(frozen=True)
class Poses:
    """Positions and headings of all agents, in 3-D."""

    positions: Array
    """Output points [m], shape (N, 3)."""
    headings: Array
    """Unit vectors, or zero where an agent has none, shape (N, 3)."""


@dataclass(frozen=True)
class Kinematics:
    """Maps from a swarm's state and inputs to poses and arrows, compiled when needed."""

    composed: ComposedSet

    @cached_property
    def inputs(self) -> tuple[slice, ...]:
        """Each agent's slice of the stacked inputs."""
        return stacked_slices([len(m.dynamics.inputs) for m in self.composed.members])

    def poses(self, x: Array) -> Poses:
        """The poses at a state, shape (n̄,)."""
        return self._kept_poses(x.tobytes())

    def effects(self, x: Array, u: Array) -> Array:
        """Effects of inputs, shape (Σ m_i,), on the lowest derivative of p they reach, (N, 3)."""
        found: Array = self._effects(x, u)[0].reshape(-1, 3)
        return found

    @cached_property
    def _kept_poses(self) -> Callable[[bytes], Poses]:
        """Poses, cached for the last state: history and picture need those of each frame."""

        def poses(x: bytes) -> Poses:
            positions, headings = self._poses(np.frombuffer(x))
            return Poses(positions.reshape(-1, 3), unit(headings.reshape(-1, 3)))

        return lru_cache(maxsize=1)(poses)

    @cached_property
    def _poses(self) -> CompiledFunction:
        composed = self.composed
        headings = [
            _heading(m.dynamics, composed.x[part])
            for m, part in zip(composed.members, composed.parts, strict=True)
        ]
        positions = ca.vertcat(*[_in_space(p) for p in composed.positions])
        return CompiledFunction([composed.x], [positions, ca.vertcat(*headings)])

    @cached_property
    def _effects(self) -> CompiledFunction:
        composed = self.composed
        u = ca.SX.sym("u", self.inputs[-1].stop)
        effects = [
            _effect(m.dynamics, composed.x[part], u[own])
            for m, part, own in zip(composed.members, composed.parts, self.inputs, strict=True)
        ]
        return CompiledFunction([composed.x, u], [ca.vertcat(*effects)])


def _in_space(p: ca.SX) -> ca.SX:
    return ca.vertcat(p, ca.SX.zeros(3 - p.numel()))


def _heading(dynamics: Dynamics, x: ca.SX) -> ca.SX:
    """An agent's heading: along its heading angle, else along its velocity if x has that."""
    for k, name in enumerate(dynamics.states):
        if name in _HEADING_STATES:
            return ca.vertcat(ca.cos(x[k]), ca.sin(x[k]), 0)
    return _in_space(ca.jacobian(dynamics.position(x), x) @ dynamics.drift(x))


def _effect(dynamics: Dynamics, x: ca.SX, u: ca.SX) -> ca.SX:
    """The lowest time derivative of the output point that depends on u, as a 3-vector."""
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    y = dynamics.position(x)
    for _ in range(x.numel()):
        y = ca.jacobian(y, x) @ rate
        if ca.depends_on(y, u):
            return _in_space(y)
    return ca.SX.zeros(3)


def in_space(p: Array) -> Array:
    """A point of the plane or of space as one of space, shape (3,)."""
    return np.pad(p, (0, 3 - len(p)))


def unit(vectors: Array) -> Array:
    """Vectors, shape (..., 3), at length one; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Array = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 1e-9)
    return units


def rotations_to(headings: Array) -> Array:
    """Quaternions, shape (N, 4), that rotate +x to unit headings, shape (N, 3).

    A zero heading gives no rotation.
    """
    x, y, z = headings.T
    # Half-way between no rotation and twice the rotation; for a heading of -x that is the zero
    # quaternion, and any half turn will do: about z.
    half = np.stack([1.0 + x, np.zeros_like(x), -z, y], axis=1)
    behind = x < -1.0 + 1e-9
    half[behind] = [0.0, 0.0, 0.0, 1.0]
    quaternions: Array = half / np.linalg.norm(half, axis=1, keepdims=True)
    return quaternions
