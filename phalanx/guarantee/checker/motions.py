"""What a recording says of each agent's motion, and how far that can have gone astray."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.checker.interval_function import IntervalFunction
from phalanx.guarantee.checker.intervals import (
    Interval,
    Truth,
    UncertifiableError,
    absolute,
    add,
    inside,
    multiply,
    norm,
    point,
    subtract,
)
from phalanx.scenario.agents import AgentGroup
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.composition import Member

Array = NDArray[np.float64]

_ENCLOSURES = 5
"""Boxes to try before a motion counts as unbounded."""
_ACTUATOR = 2e-5
"""How far an input may lie outside U: actuators let 1e-5 pass at every face."""
_ROUNDING = 1e-12
"""How far a recorded state may be off its motion, relative to both: the plant rounds at each step.
What its integration is off is far less than what an enclosure is too wide."""


class StateRecord(Protocol):
    """The true state at an event: a sample taken or an input applied."""

    t: float
    x: list[float]


class StepRecord(Protocol):
    """An input that took effect at t_apply."""

    agent: str
    t_apply: float
    u: list[float]


class HeldInputs(NamedTuple):
    """What one agent's actuator held, input after input."""

    t: Array
    """Since when [s], shape (s,)."""
    until: Array
    """[s], shape (s,)."""
    u: Array
    """shape (m, s)"""


class Motion(NamedTuple):
    """Where an agent may be within a time, of s motions."""

    box: Interval
    """shape (n, s)"""
    rates: Interval
    """f + g u without φ, in the box, shape (n, s)."""
    known: Truth
    """Whether it cannot leave the box, shape (s,)."""


class AgentMotion:
    """One agent's dynamics, inputs and disturbance, bounded."""

    def __init__(self, member: Member, part: slice, group: AgentGroup, latency: float) -> None:
        """part: where its state lies in x. Raises UncertifiableError."""
        self.name, self.part = member.name, part
        self.disturbance = group.disturbance.bound
        """φ^max."""
        self.longest = group.clock.period + group.clock.jitter + latency
        """Longest planned time between two inputs [s]."""
        self._n, m = len(member.dynamics.states), len(member.dynamics.inputs)
        x, u = ca.SX.sym("x", self._n), ca.SX.sym("u", m)
        dynamics = member.dynamics
        self._field = IntervalFunction([x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
        polytope = constant_polytope(*dynamics.input_polytope(x))
        if polytope is None:
            raise UncertifiableError(f"the inputs that agent {self.name} may apply vary with x")
        low, high = polytope.corners.min(axis=0), polytope.corners.max(axis=0)
        self._inputs = Interval(low[:, None] - _ACTUATOR, high[:, None] + _ACTUATOR)

    def anywhere(self, s: int) -> Interval:
        """Any input, shape (m, s)."""
        shape = len(self._inputs.lo), s
        return Interval(
            *(np.broadcast_to(end, shape) for end in (self._inputs.lo, self._inputs.hi))
        )

    def moved(self, x: Array, u: Interval, T: Array) -> Motion:
        """The motions over [0, T] from x, shape (n, s), under u, shape (m, s), and any φ."""
        phi = np.full((self._n, 1), self.disturbance)
        begin, span = point(x), Interval(np.zeros_like(T), T)
        box = begin
        for _ in range(_ENCLOSURES):
            (rates,), smooth = self._field(box, u)
            reached = add(begin, multiply(span, add(rates, Interval(-phi, phi))))
            stays = inside(reached, box)
            if stays.all():
                break
            margin = 0.1 * (reached.hi - reached.lo) + 16 * np.spacing(np.abs(x))
            wider = Interval(reached.lo - margin, reached.hi + margin)
            box = Interval(np.where(stays, box.lo, wider.lo), np.where(stays, box.hi, wider.hi))
        return Motion(reached, rates, stays & smooth)

    def require_motion(self, times: Array, x: Array, inputs: HeldInputs) -> None:
        """Raise UncertifiableError unless states x, shape (n, e), at times (e,) may follow so.

        Over dt the state moves by dt (f + g u) somewhere in the box, and by at most dt φ^max more.
        """
        admitted = inside(point(inputs.u), self._inputs)
        self._require(admitted, inputs.t, "applied an input that it does not have")
        in_force = inputs.u[:, np.searchsorted(inputs.t, times[:-1], side="right") - 1]
        dt = np.diff(times)
        motion = self.moved(x[:, :-1], point(in_force), dt)
        other = subtract(
            subtract(point(x[:, 1:]), point(x[:, :-1])), multiply(point(dt), motion.rates)
        )
        push = self.disturbance * dt
        moved = dt * absolute(motion.rates).hi.max(axis=0) + push
        slack = _ROUNDING * (np.abs(x[:, :-1]).max(axis=0) + moved)
        follows = norm(absolute(other)).lo <= push + slack
        self._require(
            follows & motion.known,
            times[:-1],
            "moves otherwise than its inputs and disturbances allow",
        )

    def _require(self, holds: Truth, times: Array, otherwise: str) -> None:
        if not holds.all():
            t = times[np.argmin(holds)]
            raise UncertifiableError(f"agent {self.name} {otherwise}, at t = {t:.6f} s")


def track(states: Sequence[StateRecord], n: int) -> tuple[Array, Array]:
    """Times, shape (e,), and states, shape (n, e). Raises UncertifiableError."""
    if not states or any(len(state.x) != n for state in states):
        raise UncertifiableError(f"expected states of {n} components")
    times, x = np.array([s.t for s in states]), np.array([s.x for s in states]).T
    if times[0] != 0.0 or not (np.diff(times) >= 0.0).all() or not np.isfinite(x).all():
        raise UncertifiableError("expected finite states in order from t = 0 on")
    return times, x


def inputs_of(member: Member, times: Array, steps: Sequence[StepRecord]) -> HeldInputs:
    """What a member's actuator held: zeros until its first input. Raises UncertifiableError."""
    m = len(member.dynamics.inputs)
    own = sorted((s for s in steps if s.agent == member.name), key=lambda s: s.t_apply)
    if any(len(step.u) != m for step in own):
        raise UncertifiableError(f"expected inputs of {m} components of agent {member.name}")
    t, u = [step.t_apply for step in own], [step.u for step in own]
    if not t or t[0] > 0.0:
        t, u = [0.0, *t], [[0.0] * m, *u]
    since = np.array(t)
    if not np.isin(since, times).all():
        raise UncertifiableError(f"agent {member.name} applied an input in a state not recorded")
    return HeldInputs(since, np.append(since[1:], times[-1]), np.array(u).reshape(-1, m).T)
