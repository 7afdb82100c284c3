"""Runge-Kutta steps of all agents, with one compiled call for all agents of equal dynamics."""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction, MappedRows
from phalanx.theory.models.dynamics import Dynamics, motion_texts, weighted_rates
from phalanx.theory.safety.composition import Member, stacked_slices


class DynamicsGroup(NamedTuple):
    """r agents with the same equation of motion; their input bounds may differ."""

    dynamics: Dynamics
    agents: Index
    """shape (r,)"""
    states: Index
    """Indices of their states in the stacked state, shape (r, n)."""
    inputs: Index
    """Indices of their inputs in the stacked inputs, shape (r, m)."""


class _Steps(NamedTuple):
    """Compiled steps of r agents with the same equation of motion."""

    states: Index
    """Indices of their states in the stacked state, shape (r, n)."""
    after: Index
    """Indices of states and output positions in the stack of both, shape (r, n + d)."""
    steps: list[MappedFunction]
    """For 1 to `most` steps: state and position after each, shape (steps, n + d)."""
    rows: list[tuple[MappedRows, Array]]
    """The same of these agents, with the results of the last call, shape (steps, r, n + d)."""
    position: MappedFunction


class Motion:
    """Classical fourth-order Runge-Kutta steps; no agent's motion depends on another's."""

    def __init__(self, members: Sequence[Member], most: int) -> None:
        """Compile the steps; `most` is the largest number of steps in one call."""
        groups = by_dynamics(members)
        axes = int(members[0].dynamics.position(ca.SX(groups[0].states.shape[1], 1)).numel())
        self._axes, self.groups = axes, list[_Steps]()
        self._outputs = axes * len(members)
        self._group_of: dict[int, _Steps] = {}
        """By member."""
        total, held = sum(g.states.size for g in groups), sum(g.inputs.size for g in groups)
        self._numbers = np.empty(3 * total + held + 1)
        """Arguments of a step, stacked: x, u, φ, φ' and dt."""
        self._arguments = np.split(self._numbers, np.cumsum([total, held, total, total]))
        for dynamics, agents, x, u in groups:
            dt = np.full((len(agents), 1), len(self._numbers) - 1)
            phi = total + held + x
            numbers = np.concatenate([x, total + u, phi, total + phi, dt], axis=1)
            steps = [_runge_kutta(dynamics, count) for count in range(1, most + 1)]
            p = total + axes * agents[:, None] + np.arange(axes)
            state = ca.SX.sym("x", len(dynamics.states))
            position = MappedFunction([state], [dynamics.position(state)])
            rows = [function.at(numbers) for function in steps]
            results = [
                function.results.reshape(len(agents), count, -1).swapaxes(0, 1)
                for count, function in enumerate(rows, start=1)
            ]
            both = list(zip(rows, results, strict=True))
            group = _Steps(x, np.hstack([x, p]), steps, both, position)
            self.groups.append(group)
            self._group_of |= dict.fromkeys(agents.tolist(), group)

    def steps(
        self, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return stacked states, (count, n̄), and positions [m], (count, N, d), after each step.

        Args:
            count: number of steps.
            x: stacked state, shape (n̄,).
            u: stacked inputs that the actuators hold.
            phi: stacked disturbance at the begin, shape (n̄,).
            slope: time derivative of the disturbance, shape (n̄,).
            dt: length of each step [s].
        """
        states = x.size
        values: tuple[Array | float, ...] = x, u, phi, slope, dt
        for part, value in zip(self._arguments, values, strict=True):
            part[:] = value
        after = np.empty((count, states + self._outputs))
        for group in self.groups:
            rows, results = group.rows[count - 1]
            rows(self._numbers)
            after[:, group.after] = results
        return after[:, :states], after[:, states:].reshape(count, -1, self._axes)

    def one_agent(
        self, i: int, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return the same for member i alone, from its own parts: (count, n_i) and (count, d)."""
        numbers = np.concatenate([x, u, phi, slope, [dt]])
        values = self._group_of[i].steps[count - 1](numbers, np.arange(len(numbers))[None])
        both = values.reshape(count, -1)
        return both[:, : len(x)], both[:, len(x) :]

    def positions(self, x: Array) -> Array:
        """Output positions of all agents [m] at a stacked state x, (n̄,); shape (N, d)."""
        here = np.empty(x.size + self._outputs)
        for group in self.groups:
            here[group.after[:, -self._axes :]] = group.position(x, group.states)
        return here[len(x) :].reshape(-1, self._axes)


def by_dynamics(members: Sequence[Member]) -> list[DynamicsGroup]:
    """Group members that have the same equation of motion."""
    all_dynamics, groups = [m.dynamics for m in members], defaultdict[str, list[int]](list)
    for i, text in enumerate(motion_texts(all_dynamics)):
        groups[text].append(i)
    states = stacked_slices([len(dynamics.states) for dynamics in all_dynamics])
    inputs = stacked_slices([len(dynamics.inputs) for dynamics in all_dynamics])
    return [
        DynamicsGroup(
            all_dynamics[agents[0]],
            np.array(agents),
            *(np.array([np.r_[parts[i]] for i in agents]) for parts in (states, inputs)),
        )
        for agents in groups.values()
    ]


def _runge_kutta(dynamics: Dynamics, steps: int) -> MappedFunction:
    """(x, u, φ, φ', dt) -> x and p after each step; φ is the value at the first one's begin."""
    start, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    phi, slope = ca.SX.sym("phi", start.numel()), ca.SX.sym("slope", start.numel())
    dt, x = ca.SX.sym("dt"), start
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    field = ca.Function("f", [x, u], [rate])
    after = []
    for step in range(steps):
        begin = phi + step * dt * slope
        pushes = begin, begin + dt / 2 * slope, begin + dt * slope
        x = x + dt / 6 * weighted_rates(field, x, u, pushes, dt)
        after.append(ca.horzcat(x.T, dynamics.position(x).T))
    return MappedFunction([start, u, phi, slope, dt], [ca.vertcat(*after)])
