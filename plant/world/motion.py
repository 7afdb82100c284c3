"""The dynamics of all agents, in one call for all that move alike, and where that takes them."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.mapped import Index, MappedFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.composition import Member

Array = NDArray[np.float64]


class _Alike(NamedTuple):
    """Agents that move alike."""

    states: Index
    """Where their states lie in the stack, shape (r, n)."""
    numbers: Index
    """Where x, u, φ, φ' and dt lie in the stack of all five, shape (r, k)."""
    steps: list[MappedFunction]
    """For 1 to `most` steps: the states after each, shape (steps, n)."""
    position: MappedFunction


class Motion:
    """Classical fourth-order Runge-Kutta steps of all agents; no agent's depend on the others."""

    def __init__(self, members: Sequence[Member], most: int) -> None:
        """most: steps at once."""
        states = _begins([len(m.dynamics.states) for m in members])
        inputs = _begins([len(m.dynamics.inputs) for m in members])
        self._alike: list[_Alike] = []
        found: list[Index] = []
        for each in _alike(members):
            own, dynamics = np.array(each), members[each[0]].dynamics
            x = states[own][:, None] + np.arange(len(dynamics.states))
            u = inputs[own][:, None] + np.arange(len(dynamics.inputs))
            total, dt = states[-1], np.full((len(own), 1), 3 * states[-1] + inputs[-1])
            phi = total + inputs[-1] + x
            numbers = np.concatenate([x, total + u, phi, total + phi, dt], axis=1)
            steps = [_runge_kutta(dynamics, count) for count in range(1, most + 1)]
            self._alike.append(_Alike(x, numbers, steps, _position(dynamics)))
            found.append(own)
        self._order: Index = np.argsort(np.concatenate(found))
        """Of members, sorted by how they move, in their own order."""
        kinds = np.repeat(np.arange(len(found)), [len(own) for own in found])
        self._kinds = kinds[self._order].tolist()

    def steps(self, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float) -> Array:
        """The stacked states after each of `count` steps, shape (count, n̄).

        Args:
            count: of steps.
            x: stacked state, shape (n̄,).
            u: stacked inputs that actuators hold.
            phi: stacked disturbance at the first step's begin, shape (n̄,).
            slope: of the disturbance's line, shape (n̄,).
            dt: of each step [s].
        """
        numbers = np.concatenate([x, u, phi, slope, [dt]])
        after = np.empty((count, len(x)))
        for alike in self._alike:
            found = alike.steps[count - 1](numbers, alike.numbers)
            after[:, alike.states] = found.reshape(len(found), count, -1).swapaxes(0, 1)
        return after

    def one_through(
        self, i: int, count: int, x: Array, u: Array, phi: Array, slope: Array, dt: float
    ) -> Array:
        """Member i's state after `count` of the same steps, shape (n_i,); all parts are its own."""
        numbers = np.concatenate([x, u, phi, slope, [dt]])
        steps = self._alike[self._kinds[i]].steps[count - 1]
        last: Array = steps(numbers, np.arange(len(numbers))[None])[0, -len(x) :]
        return last

    def positions(self, x: Array) -> Array:
        """Output positions of all agents [m] at stacked states x, (s, n̄); shape (s, N, d)."""
        found = [alike.position(x, alike.states) for alike in self._alike]
        return np.concatenate(found, axis=1)[:, self._order]


def _begins(sizes: Sequence[int]) -> Index:
    """Where each part of a stack begins, and where the stack ends."""
    return np.cumsum([0, *sizes])


def _alike(members: Sequence[Member]) -> list[list[int]]:
    """Members that move alike, whatever bounds their inputs have."""
    text = {id(m.dynamics): _text(m.dynamics) for m in members}
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
    """(x, u, φ, φ', dt) -> x after each step; φ is at the first one's begin, on its line."""
    start, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    phi, slope = ca.SX.sym("phi", start.numel()), ca.SX.sym("slope", start.numel())
    dt, x = ca.SX.sym("dt"), start
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    field = ca.Function("f", [x, u], [rate])
    after = []
    for step in range(steps):
        begin = phi + step * dt * slope
        middle, end = begin + dt / 2 * slope, begin + dt * slope
        k1 = field(x, u) + begin
        k2 = field(x + dt / 2 * k1, u) + middle
        k3 = field(x + dt / 2 * k2, u) + middle
        k4 = field(x + dt * k3, u) + end
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        after.append(x.T)
    return MappedFunction([start, u, phi, slope, dt], [ca.vertcat(*after)])


def _position(dynamics: Dynamics) -> MappedFunction:
    x = ca.SX.sym("x", len(dynamics.states))
    return MappedFunction([x], [dynamics.position(x)])
