"""The disturbances φ_i(t): linear between knots, random or adverse."""

import math
from dataclasses import dataclass

import numpy as np

from phalanx.network.draws import Seeds, Tables
from phalanx.scenario.agents import Disturbance
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length


@dataclass(frozen=True)
class Line:
    """φ(t) = value + slope (t - begin) for t in [begin, end]."""

    begin: float
    end: float
    value: Array
    slope: Array

    def at(self, t: float) -> Array:
        """φ(t)."""
        phi: Array = self.value + self.slope * (t - self.begin)
        return phi


class RandomDisturbance:
    """Random φ_i of one agent; locally Lipschitz, and ‖φ_i‖ <= φ_i^max everywhere.

    Knots are uniform in the cube inscribed in the ball of radius φ_i^max. The ball is convex, so
    the lines between knots stay inside.
    """

    def __init__(self, seeds: Seeds | int, agent: str, model: Disturbance, n: int) -> None:
        """Draw φ_i for a state of n components."""
        self._tables = Tables(seeds, "disturbance", agent, width=n)
        self._half_width = model.bound / math.sqrt(n)
        self._every = model.every

    def line(self, t: float, _x: Array | None = None) -> Line:
        """Return the line that holds from t [s] on."""
        knot = _last_knot(t, self._every)
        # The knot ahead is decided at the one before it, which keeps φ continuous.
        self._tables.decide(knot + 1, knot * self._every)
        return _between(knot, self._every, self._knot(knot), self._knot(knot + 1))

    def _knot(self, index: int) -> Array:
        value: Array = self._half_width * (2.0 * self._tables()[index] - 1.0)
        return value


class AdverseDisturbance:
    """Worst-case φ_i: the largest push along the gradient of ψ_{q-1}, evaluated at each knot.

    It reaches a knot's push one knot later, so that φ_i is continuous.
    """

    def __init__(self, gradient: "SwarmGradient", part: slice, model: Disturbance) -> None:
        """Push along `gradient`; `part` is the slice of the agent's state in the stack."""
        self._gradient, self._part = gradient, part
        self._bound, self._every = model.bound, model.every
        self._line: Line | None = None

    def line(self, t: float, x: Array) -> Line:
        """Return the line that holds from t [s] on, given the stacked state x there, (n̄,)."""
        if self._line is None or t >= self._line.end:
            knot = _last_knot(t, self._every)
            before = self._line.at(self._line.end) if self._line else self._push(x)
            self._line = _between(knot, self._every, before, self._push(x))
        return self._line

    def _push(self, x: Array) -> Array:
        gradient = self._gradient(x)[self._part]
        # Far from all others its squares would underflow. A power of two changes no other bits.
        gradient = np.ldexp(gradient, -math.frexp(float(np.abs(gradient).max()))[1])
        size = float(length(gradient))
        push: Array = self._bound / size * gradient if size > 0.0 else 0.0 * gradient
        return push


def _last_knot(t: float, every: float) -> int:
    knot = math.floor(t / every)
    # If t is a knot, the division may have rounded down.
    return knot + 1 if (knot + 1) * every <= t else knot


def _between(knot: int, every: float, here: Array, there: Array) -> Line:
    begin, end = knot * every, (knot + 1) * every
    return Line(begin, end, here, (there - here) / (end - begin))


class SwarmGradient:
    """∂ψ_{q-1}/∂x of h_tot, all pairs composed."""

    def __init__(self, rows: SafetyRows) -> None:
        pairs = rows.swarm.pairs
        self._pairs = pairs.choose(pairs.every)
        self._jets = rows.composed.jets
        self._x = self._gradient = np.zeros(0)

    def __call__(self, x: Array) -> Array:
        """Evaluate at a stacked state x, shape (n̄,)."""
        # Agents of a swarm have their knots at the same times: one evaluation serves them all.
        if not np.array_equal(x, self._x):
            pairs, weights = self._pairs, self._jets(self._pairs.jets(x).h).weights
            slopes = (weights.T[:, pairs.slope_pair] * pairs.slopes(x)).sum(axis=0)
            gradient = np.bincount(pairs.slope_state, slopes, len(x))
            self._x, self._gradient = x.copy(), gradient.astype(np.float64, copy=False)
        return self._gradient


class SwarmDisturbance:
    """All φ_i, stacked as the state is, shape (n̄,)."""

    def __init__(self, rows: SafetyRows) -> None:
        """Make each agent's disturbance; adverse ones follow the gradient of `rows`."""
        swarm, gradient = rows.swarm, None
        self._disturbances: list[RandomDisturbance | AdverseDisturbance] = []
        for i, (group, part) in enumerate(zip(swarm.groups, swarm.safe_set.parts, strict=True)):
            model = group.disturbance
            if model.kind == "adverse":
                gradient = gradient or SwarmGradient(rows)
                self._disturbances.append(AdverseDisturbance(gradient, part, model))
            else:
                name, states = swarm.names[i], part.stop - part.start
                self._disturbances.append(RandomDisturbance(swarm.seeds, name, model, states))

    def line(self, t: float, x: Array) -> Line:
        """Return the stack's line from t [s], in state x there, to the first knot of any agent."""
        lines = [d.line(t, x) for d in self._disturbances]
        value = np.concatenate([line.at(t) for line in lines])
        slope = np.concatenate([line.slope for line in lines])
        return Line(t, min(line.end for line in lines), value, slope)
