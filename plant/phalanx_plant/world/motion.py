"""The dynamics of all agents, in one call for all that move alike, and where that takes them."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.composition import Member


class _Alike(NamedTuple):
    """Agents that move alike."""

    states: Index
    """Where their states lie in the stack, shape (r, n)."""
    after: Index
    """Where states and output positions lie in the stack of both, shape (r, n + d)."""
    numbers: Index
    """Where x, u, φ, φ' and dt lie in the stack of all five, shape (r, k)."""
    steps: list[MappedFunction]
    """For 1 to `most` steps: state and position after each, shape (steps, n + d)."""
    position: MappedFunction


class Motion:
    """Classical fourth-order Runge-Kutta steps of all agents; no agent's depend on the others."""

    def __init__(self, members: Sequence[Member], most: int) -> None:
        """most: steps at once."""
        states = _begins([len(m.dynamics.states) for m in members])
        inputs = _begins([len(m.dynamics.inputs) for m in members])
        axes = int(members[0].dynamics.position(ca.SX(states[1], 1)).numel())
        self._axes, self._alike = axes, list[_Alike]()
        self._of: dict[int, _Alike] = {}
        """By member."""
        for each in alike(members):
            own, dynamics = np.array(each), members[each[0]].dynamics
            x = states[own][:, None] + np.arange(len(dynamics.states))
            u = inputs[own][:, None] + np.arange(len(dynamics.inputs))
            total, dt = states[-1], np.full((len(own), 1), 3 * states[-1] + inputs[-1])
            phi = total + inputs[-1] + x
            numbers = np.concatenate([x, total + u, phi, total + phi, dt], axis=1)
            steps = [_runge_kutta(dynamics, count) for count in range(1, most + 1)]
            p = total + axes * own[:, None] + np.arange(axes)
            kind = _Alike(x, np.hstack([x, p]), numbers, steps, _position(dynamics))
            self._alike.append(kind)
            self._of |= dict.fromkeys(each, kind)

    def steps(
        self, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float
    ) -> tuple[Array, Array]:
        """Stacked states, (count, n̄), and output positions [m], (count, N, d), after each step.

        Args:
            count: of steps.
            x: stacked state, shape (n̄,).
            u: stacked inputs that actuators hold.
            phi: stacked disturbance at the first step's begin, shape (n̄,).
            slope: of the disturbance's line, shape (n̄,).
            dt: of each step [s].
        """
        numbers = np.concatenate([x, u, phi, slope, [dt]])
        after = np.empty((count, len(x) + self._axes * len(self._of)))
        for alike in self._alike:
            found = alike.steps[count - 1](numbers, alike.numbers)
            after[:, alike.after] = found.reshape(len(found), count, -1).swapaxes(0, 1)
        return after[:, : len(x)], after[:, len(x) :].reshape(count, -1, self._axes)

    def one_through(
        self, i: int, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float
    ) -> tuple[Array, Array]:
        """The same of member i, (count, n_i) and (count, d); all arguments are its own parts."""
        numbers = np.concatenate([x, u, phi, slope, [dt]])
        found = self._of[i].steps[count - 1](numbers, np.arange(len(numbers))[None])
        each = found.reshape(count, -1)
        return each[:, : len(x)], each[:, len(x) :]

    def positions(self, x: Array) -> Array:
        """Output positions of all agents [m] at a stacked state x, (n̄,); shape (N, d)."""
        here = np.empty(len(x) + self._axes * len(self._of))
        for alike in self._alike:
            here[alike.after[:, -self._axes :]] = alike.position(x, alike.states)
        return here[len(x) :].reshape(-1, self._axes)


def _begins(sizes: Sequence[int]) -> Index:
    """Where each part of a stack begins, and where the stack ends."""
    return np.cumsum([0, *sizes])


def alike(members: Sequence[Member]) -> list[list[int]]:
    """Members that move alike, whatever bounds their inputs have."""
    different = {id(m.dynamics): m.dynamics for m in members}
    text = {number: _text(dynamics) for number, dynamics in different.items()}
    found: dict[str, list[int]] = {}
    for i, m in enumerate(members):
        found.setdefault(text[id(m.dynamics)], []).append(i)
    return list(found.values())


def _text(dynamics: Dynamics) -> str:
    """What tells motions apart: the expressions of x' and of the output position."""
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    outputs = [ca.densify(rate), ca.densify(dynamics.position(x))]
    found: str = ca.Function("motion", [x, u], outputs).serialize()
    return found


def _runge_kutta(dynamics: Dynamics, steps: int) -> MappedFunction:
    """(x, u, φ, φ', dt) -> x and p after each step; φ is at the first one's begin, on its line."""
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


def weighted_rates(
    field: ca.Function, x: ca.SX, u: ca.SX, pushes: tuple[ca.SX, ca.SX, ca.SX], dt: ca.SX
) -> ca.SX:
    """Six times the mean rate of a step, shape (n,); φ at its begin, its middle and its end."""
    begin, middle, end = pushes
    k1 = field(x, u) + begin
    k2 = field(x + dt / 2 * k1, u) + middle
    k3 = field(x + dt / 2 * k2, u) + middle
    k4 = field(x + dt * k3, u) + end
    return k1 + 2 * k2 + 2 * k3 + k4


def _position(dynamics: Dynamics) -> MappedFunction:
    x = ca.SX.sym("x", len(dynamics.states))
    return MappedFunction([x], [dynamics.position(x)])
