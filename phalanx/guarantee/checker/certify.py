"""Certify a recorded run: that no pair could leave its safe set, whatever happened in between.

An agent i applies an input u_i at t_k, in the true state x(t_k), and holds it. For one of its pairs
let R_w = L_f h + L_g h u_i + L_g h w be the rate of h while the other agent applies w, and B a box
that the pair does not leave for T: a Picard enclosure, u_i held, the other agent's input anywhere
in its U, every φ anywhere in its ball. Then for 0 <= t <= T

    h(t_k + t) <= h + t (max_w R_w + D) + ½ t² g,

h and R_w at x(t_k), with D = sup_B Σ_l ‖∂h/∂x_l‖ φ_l^max for what disturbances do to h, and g the
supremum over B, every w and every motion of dR_w/dt with w fixed, or 0 if that is more. Proof: h'
is at most R_w + D for the w of that instant, and no R_w grows faster than g. The bound is convex in
t: where it is not above 0 at both ends, it is not above 0 between. If no input appears in h'
(q > 1), L_g h = 0 and the same bound serves.

This certificate ends when agent i's next input takes effect, or where the bound reaches 0. A run is
certified if the certificates of the normal agents of every pair leave no instant uncovered. Assumed
are the dynamics and the disturbance bounds; a recording that is no motion of them is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.checker.intervals import (
    Interval,
    IntervalFunction,
    Truth,
    UncertifiableError,
    absolute,
    add,
    dot,
    inside,
    multiply,
    norm,
    point,
    stack,
    subtract,
    total,
)
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.model import Scenario
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.composition import ComposedSet, Member, compose

Array = NDArray[np.float64]

_RUNGS = (8.0, 4.0, 2.0, 1.0 + 1e-9)  # a hair beyond: ends are rounded down
"""Horizons to try, over the longest planned time between two inputs of an agent."""
_AT_ONCE = 2048
"""Samples evaluated together: few enough that their intervals stay in a cache."""
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


@dataclass(frozen=True)
class Gap:
    """From when on [s] a pair has no certificate."""

    t: float
    pair: str


@dataclass(frozen=True)
class Certification:
    """What the certificates of a run come to; true if they cover it."""

    samples: int
    """Inputs that normal agents applied."""
    certified: int
    """Those whose certificates, of all pairs, last until the next input."""
    horizon: float
    """The shortest time that any certificate lasts if nothing more is heard [s]; looked for up to
    four times the longest planned time between inputs. 0 where there is none."""
    gap: Gap | None
    """The first instant that is not covered."""

    def __bool__(self) -> bool:
        return self.gap is None


def certify(
    scenario: Scenario,
    states: Sequence[StateRecord],
    steps: Sequence[StepRecord],
    progress: Callable[[float], None] = lambda share: None,
) -> Certification:
    """Certify a run from its scenario and its records; progress is told the share that is done.

    Raises:
        UncertifiableError: an operation without an interval rule, a U that varies with the state,
            or records that contradict the scenario.
    """
    roster = list(scenario.roster())
    members = [Member(n, g.dynamics_object(), g.role == "adversary") for n, g, _ in roster]
    normal = [i for i, member in enumerate(members) if not member.adversary]
    safety, latency = scenario.safety, scenario.time.latency
    swarm = compose(members, scenario.static, safety.safe_set_function(), safety.rho)
    agents = [
        _Agent(member, part, group, latency)
        for member, part, (_, group, _) in zip(members, swarm.parts, roster, strict=True)
    ]
    pairs = [_Pair(swarm, p, agents) for p in range(len(swarm.pairs))]
    # Infinity and NaN are what bounds say that they do not know.
    with np.errstate(all="ignore"):
        times, x = _track(states, swarm.x.numel())
        inputs = [_inputs(member, times, steps) for member in members]
        for agent, held in zip(agents, inputs, strict=True):
            agent.require_motion(times, x[agent.part], held)
        certificates = []
        for done, i in enumerate(normal):
            sampled = x[:, np.searchsorted(times, inputs[i].t)]
            own = [pair for pair in pairs if i in pair.members]
            horizons = _horizons(i, sampled, inputs[i].u, agents, own)
            certificates.append(_Certificates(own, inputs[i], horizons))
            progress((done + 1) / len(normal))
    return _conclude(certificates, pairs, scenario.duration)


class _Inputs(NamedTuple):
    """What one agent's actuator held, input after input."""

    t: Array
    """Since when [s], shape (s,)."""
    until: Array
    """[s], shape (s,)."""
    u: Array
    """shape (m, s)"""


class _Motion(NamedTuple):
    """Where an agent may be within a time, of s motions."""

    box: Interval
    """shape (n, s)"""
    rates: Interval
    """f + g u without φ, in the box, shape (n, s)."""
    known: Truth
    """Whether it cannot leave the box, shape (s,)."""


class _Agent:
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

    def moved(self, x: Array, u: Interval, T: Array) -> _Motion:
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
        return _Motion(reached, rates, stays & smooth)

    def require_motion(self, times: Array, x: Array, inputs: _Inputs) -> None:
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


class _Pair:
    """h of one pair, and how fast it may rise."""

    def __init__(self, swarm: ComposedSet, index: int, agents: Sequence[_Agent]) -> None:
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

    def horizons(self, x: Array, motions: Sequence[_Motion], u: Interval, T: Array) -> Array:
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


class _Certificates:
    """Those of one agent, for each of its pairs."""

    def __init__(self, pairs: Sequence[_Pair], inputs: _Inputs, horizons: Array) -> None:
        """horizons: shape (p, s) [s]."""
        self.pairs, self.horizons = list(pairs), horizons
        self._begin = inputs.t
        # Rounded down: no instant counts that a bound does not reach.
        self._end = np.minimum(np.nextafter(inputs.t + horizons, -np.inf), inputs.until)
        self.lasting: Truth = np.logical_and.reduce(self._end >= inputs.until, axis=0)
        """Which last, for all pairs, until the next input, shape (s,)."""

    def spans(self, pair: _Pair) -> tuple[Array, Array]:
        """Where they begin and end for one pair [s], shapes (s,)."""
        return self._begin, self._end[self.pairs.index(pair)]


def _horizons(
    i: int,
    x: Array,
    u: Array,
    agents: Sequence[_Agent],
    pairs: Sequence[_Pair],
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
    i: int, x: Array, u: Array, T: float, agents: Sequence[_Agent], pairs: Sequence[_Pair]
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


def _conclude(
    found: Sequence[_Certificates], pairs: Sequence[_Pair], duration: float
) -> Certification:
    gaps = []
    for pair in pairs:
        spans = [each.spans(pair) for each in found if pair in each.pairs]
        begin, end = (np.concatenate(side) for side in zip(*spans, strict=True))
        gaps += [Gap(float(t), pair.label) for t in _uncovered(begin, end, duration)]
    lasting = [each.lasting for each in found]
    return Certification(
        samples=sum(each.size for each in lasting),
        certified=sum(int(each.sum()) for each in lasting),
        horizon=max(0.0, min(float(each.horizons.min(initial=np.inf)) for each in found)),
        gap=min(gaps, key=lambda gap: gap.t, default=None),
    )


def _uncovered(begin: Array, end: Array, until: float) -> Array:
    """The first instant of [0, until] in none of the intervals, shape (1,), or none, shape (0,)."""
    some = end >= begin
    order = np.argsort(begin[some], kind="stable")
    next_begin = np.append(begin[some][order], until)
    covered = np.maximum.accumulate(np.insert(end[some][order], 0, 0.0))
    return covered[next_begin > covered][:1]


def _track(states: Sequence[StateRecord], n: int) -> tuple[Array, Array]:
    """Times, shape (e,), and states, shape (n, e). Raises UncertifiableError."""
    if not states or any(len(state.x) != n for state in states):
        raise UncertifiableError(f"expected states of {n} components")
    times, x = np.array([s.t for s in states]), np.array([s.x for s in states]).T
    if times[0] != 0.0 or not (np.diff(times) >= 0.0).all() or not np.isfinite(x).all():
        raise UncertifiableError("expected finite states in order from t = 0 on")
    return times, x


def _inputs(member: Member, times: Array, steps: Sequence[StepRecord]) -> _Inputs:
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
    return _Inputs(since, np.append(since[1:], times[-1]), np.array(u).reshape(-1, m).T)
