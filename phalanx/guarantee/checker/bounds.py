"""For how long a pair's h is certain not to rise above 0, once an agent has applied its input."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.checker.interval_function import IntervalFunction
from phalanx.guarantee.checker.intervals import (
    Interval,
    Truth,
    add,
    dot,
    multiply,
    norm,
    point,
    stack,
    total,
)
from phalanx.guarantee.checker.motions import AgentMotion, HeldInputs, Motion
from phalanx.theory.safety.composition import ComposedSet

Array = NDArray[np.float64]

_RUNGS = (8.0, 4.0, 2.0, 1.0 + 1e-9)  # a hair beyond: ends are rounded down
"""Horizons to try, over the longest planned time between two inputs of an agent."""
_AT_ONCE = 2048
"""Samples evaluated together: few enough that their intervals stay in a cache."""


class PairBound:
    """h of one pair, and how fast it may rise."""

    def __init__(self, swarm: ComposedSet, index: int, agents: Sequence[AgentMotion]) -> None:
        alone, chosen = swarm.alone(index), swarm.pairs[index]
        self.label = swarm.label(chosen)
        self.members = (chosen.a,) if chosen.b is None else (chosen.a, chosen.b)
        self._parts = alone.parts
        self._disturbances = [agents[l].disturbance for l in self.members]
        x, fields = alone.x, [m.dynamics for m in alone.members]
        u = ca.SX.sym("u", sum(len(d.inputs) for d in fields))
        own = [(d, x[part]) for d, part in zip(fields, alone.parts, strict=True)]
        drift = ca.vertcat(*[d.drift(state) for d, state in own])
        actuation = ca.diagcat(*[d.actuation(state) for d, state in own])
        gradient = ca.jacobian(alone.h, x)
        rate = gradient @ (drift + actuation @ u)
        self._now = IntervalFunction([x], [alone.h, gradient @ drift, gradient @ actuation])
        self._within = IntervalFunction([x, u], [alone.h, gradient, ca.jacobian(rate, x)])

    def horizons(self, x: Array, motions: Sequence[Motion], u: Interval, T: Array) -> Array:
        """How long h <= 0 is certain [s], shape (s,), at most T; -inf where it is not even now.

        From states x, shape (n, s), of both members, with their motions over T and inputs u.
        """
        (h, drift, actuation), now = self._now(point(x))
        box, rates = stack([m.box for m in motions]), stack([m.rates for m in motions])
        (_, gradient, growth), within = self._within(box, u)
        known = np.logical_and.reduce([now, within, *[m.known for m in motions]])
        rate = add(add(drift[0], dot(actuation, u)), self._pushed(gradient)).hi
        bend = np.maximum(add(dot(growth, rates), self._pushed(growth)).hi, 0.0)
        return np.where(known, _lasting(h[0].hi, rate, bend, T), -np.inf)

    def _pushed(self, gradient: Interval) -> Interval:
        """What disturbances may add to the rate of something with this gradient, shape (s,)."""
        parts = zip(self._parts, self._disturbances, strict=True)
        return total(stack([multiply(norm(gradient[p]), point(d))[None] for p, d in parts]))


class AgentCertificates:
    """Those of one agent, for each of its pairs."""

    def __init__(self, pairs: Sequence[PairBound], inputs: HeldInputs, horizons: Array) -> None:
        """horizons: shape (p, s) [s]."""
        self.pairs, self.horizons = list(pairs), horizons
        self._begin = inputs.t
        # Rounded down: no instant counts that a bound does not reach.
        self._end = np.minimum(np.nextafter(inputs.t + horizons, -np.inf), inputs.until)
        self.lasting: Truth = np.logical_and.reduce(self._end >= inputs.until, axis=0)
        """Which last, for all pairs, until the next input, shape (s,)."""

    def spans(self, pair: PairBound) -> tuple[Array, Array]:
        """Where they begin and end for one pair [s], shapes (s,)."""
        return self._begin, self._end[self.pairs.index(pair)]


def horizons_of(
    i: int,
    x: Array,
    u: Array,
    agents: Sequence[AgentMotion],
    pairs: Sequence[PairBound],
) -> Array:
    """How long each pair is certain [s], shape (p, s), once agent i applies u in states x."""
    found = np.full((len(pairs), x.shape[1]), -np.inf)
    for begin in range(0, x.shape[1], _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        for rung in _RUNGS:
            T = rung * agents[i].longest
            todo = begin + np.flatnonzero((found[:, some] < T).any(axis=0))
            if todo.size:
                tried = _tried(i, x[:, todo], u[:, todo], T, agents, pairs)
                found[:, todo] = np.maximum(found[:, todo], tried)
    return found


def _tried(
    i: int, x: Array, u: Array, T: float, agents: Sequence[AgentMotion], pairs: Sequence[PairBound]
) -> Array:
    """The same, looking no further than T."""
    spans = np.full(x.shape[1], T)
    inputs = [point(u) if l == i else agent.anywhere(len(spans)) for l, agent in enumerate(agents)]
    motions = [
        agent.moved(x[agent.part], given, spans)
        for agent, given in zip(agents, inputs, strict=True)
    ]
    return np.array(
        [
            pair.horizons(
                np.concatenate([x[agents[l].part] for l in pair.members]),
                [motions[l] for l in pair.members],
                stack([inputs[l] for l in pair.members]),
                spans,
            )
            for pair in pairs
        ]
    )


def _lasting(h: Array, rate: Array, bend: Array, T: Array) -> Array:
    """The largest t <= T found with h + t rate + ½ t² bend <= 0, where h <= 0; -inf if none."""
    steepest = rate + np.sqrt(rate * rate - 2.0 * bend * h)
    # The bound's zero, a little earlier, for it is rounded anyhow: what counts is the check below.
    zero = np.where(steepest > 0.0, -2.0 * h / steepest * (1.0 - 1e-9), T)
    lasting = np.full_like(T, -np.inf)
    for t in (np.minimum(zero, T), T):
        at = point(t)
        slope = add(point(rate), multiply(point(0.5 * bend), at))
        bound = add(point(h), multiply(at, slope)).hi
        lasting = np.where((h <= 0.0) & (bound <= 0.0), t, lasting)
    return lasting
