"""A normal agent with a radio: what it knows of its peers, and the filter that acts on it.

It knows a peer by its newest statement, which has an age: since then the peer can have gone to any
state of a set. Two other beliefs, to compare with, take one state for the truth.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import NamedTuple, cast

import casadi as ca
import numpy as np
from msgspec.structs import replace

from phalanx.knowledge.contradiction import contradiction
from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import stacked
from phalanx.knowledge.own_parts import OwnParts, OwnPartsInput
from phalanx.knowledge.sets import HeardState, enclosures
from phalanx.network.inbox import AnnouncedInput, Conviction, SentInput
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.points import agent_point
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import StateBox
from phalanx.theory.rows.decision import Decision, at_bound, finite_or_none
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.nearest_in_box import TOLERANCE
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import OwnPairTerms, pair_rows
from phalanx.theory.rows.safety_filter import Filtered, FilterInput, PairwiseFilter
from phalanx.theory.safety.composition import FAR
from phalanx.theory.safety.function import Distance, Separation

_PER_PERIOD = 1.2
"""κ times the time between two broadcasts, by default: with larger ones agents brake more often."""

_OFF = 1e-4
"""Distance kept from an obstacle's clearance [m]: nearer ones no certificate can prove."""


class _Heard(NamedTuple):
    """The newest state heard of a peer."""

    x: Array
    """Shape (n_l,)."""
    point: HeardState
    """Of the point that it is to others."""


class PeerKnowledge:
    """Agent i's knowledge of its peers, from what they broadcast of themselves."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Know the starts, as a mission's plan has them. Raises ScenarioError for its dynamics."""
        radio = swarm.groups[i].radio
        assert radio is not None
        self._belief, self._parts = radio.belief, swarm.safe_set.parts
        self.peers = swarm.peers(i)
        self.points = {l: agent_point(swarm, l) for l in (i, *self.peers)}
        self._periods = {l: swarm.groups[l].clock.period for l in self.peers}
        start, self._still = swarm.start(), np.zeros(self.points[i].motion.axes)
        states = {l: start[self._parts[l]] for l in self.peers}
        self._newest = {l: _Heard(x, self._standing(l, 0.0, x)) for l, x in states.items()}
        self._begun, self._t, self._starts_known = False, 0.0, radio.starts_known
        self._period = swarm.groups[i].clock.period
        self._stamp_error, self._said = radio.stamp_error, dict[int, ReceivedInput]()
        self._motions = lru_cache(maxsize=4)(
            lambda peers: stacked([self.points[l].motion for l in peers])
        )
        """Of peers."""
        self.convicted: set[int] = set()
        """Peers that contradicted themselves: nothing that they state later is believed."""
        self.convictions: list[Conviction] = []
        """Those of the last sample."""
        self.heard: Mapping[int, HeardState] = {}
        """Of each peer's point the newest state heard; if one is the truth, as if of now."""

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> tuple[Array, tuple[int, ...]]:
        """Add the states of its peers as it believes them to the stacked x, shape (n̄,), at t [s].

        received: a SentInput of each peer that was heard. Returns x and the agents in it.
        """
        # In real time the first sample is a little later than 0.
        if not (self._begun or (self._starts_known and t < self._period)):
            self._newest = {}  # so does one that has taken over from an agent that died
        self._begun, self._t, x = True, t, x.copy()
        self.convictions = []
        for l, said in received.items():
            if l in self._periods and said is not self._said.get(l):
                self._said[l] = said
                self._hear(l, self._heard(l, cast(SentInput, said)))
        believed = self._believed(t)
        for l, state in believed.items():
            x[self._parts[l]] = state
        self.heard = {l: heard.point for l, heard in self._newest.items()}
        if self._belief != "set":
            self.heard = {l: self._standing(l, t, state) for l, state in believed.items()}
        return x, tuple(sorted((*seen, *believed)))

    @property
    def age(self) -> Mapping[int, float]:
        """Time since the state that was heard of each peer was sampled [s]."""
        return {l: self._t - heard.point.t for l, heard in self._newest.items()}

    def boxes(self) -> Mapping[int, StateBox]:
        """Return for each peer the box in which its point is, by what was heard."""
        if not self._newest:
            return {}
        peers, states = zip(*((l, heard.point) for l, heard in self._newest.items()), strict=True)
        motions, times = [self.points[l].motion for l in peers], np.full(len(peers), self._t)
        low, high = enclosures(states, times, self._motions(peers), self._stamp_error)
        tubes = [np.repeat([m.tube, m.tracking.speed_tube], m.axes) for m in motions]
        return {l: (a - r, b + r) for l, a, b, r in zip(peers, low, high, tubes, strict=True)}

    def _hear(self, l: int, newer: _Heard) -> None:
        """Believe a statement of peer l, unless it contradicts the last one that was believed."""
        older, excess = self._newest.get(l), 0.0
        if older is not None and self._belief == "set":
            states = older.point, newer.point
            excess = contradiction(self.points[l].motion, *states, self._stamp_error)
        if older is not None and excess > 0.0 and l not in self.convicted:
            self.convicted.add(l)
            self.convictions.append(Conviction(l, older.point.t, newer.point.t, excess))
            # No announced input is counted on any more: a share of a gap is that of an honest peer.
            self._newest[l] = older._replace(point=older.point._replace(t_apply=math.inf))
        if l not in self.convicted:
            self._newest[l] = newer

    def _standing(self, l: int, t: float, x: Array) -> HeardState:
        """Return the state of peer l's point where it has the state x and no input at t [s]."""
        point = self.points[l].of(x)
        return HeardState(t, point, point, t, self._still)

    def _heard(self, l: int, said: SentInput) -> _Heard:
        point, x = self.points[l], np.array(said.x)
        u, z = point.input(x, np.array(said.u)), point.of(np.array(said.z))
        return _Heard(x, HeardState(said.t, point.of(x), z, said.t_apply, u))

    def _believed(self, t: float) -> dict[int, Array]:
        """Return a state of each peer at t [s]; of a set the middle, where it is without input."""
        if self._belief == "newest" or not self._newest:
            return {l: heard.x for l, heard in self._newest.items()}
        heard, motions = list(self._newest.values()), self._motions(tuple(self._newest))
        x, said = np.array([h.point.x for h in heard]), [h.point.t for h in heard]
        age = np.maximum(0.0, t - np.array(said))[:, None]
        if self._belief == "carried-on":
            # Its input is in force until its next sample; then its speed alone is known, which
            # may be that input.
            periods = np.array([[self._periods[l]] for l in self._newest])
            sure = np.where(motions.jumps > 0.0, age, np.minimum(age, periods))
            u = np.array([h.point.u for h in heard])
            x, age = moved(x, u, motions.held(sure)), age - sure
        points = moved(x, self._still, motions.held(age))
        return {
            l: self.points[l].at(h.x, point)
            for (l, h), point in zip(self._newest.items(), points, strict=True)
        }


class RadioFilter:
    """Own parts for peers, or halves of pairs' rows; whole rows for those that the agent sees."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        """Raise ScenarioError for dynamics or a safe-set function without a distance to keep."""
        swarm = rows.swarm
        radio, function = swarm.groups[i].radio, swarm.safety.safe_set_function
        assert radio is not None
        if not isinstance(function, Distance | Separation):
            raise ScenarioError(
                f"{swarm.scenario.name}: safety.function: expected 'distance' or 'separation' "
                "where there is a radio"
            )
        self.with_beliefs = PeerKnowledge(swarm, i)
        points = self.with_beliefs.points
        self._point, self._own = points[i], swarm.safe_set.parts[i]
        self._agents = len(swarm.members)
        self.reference: Array | None = None
        """The reference state at the last sample, shape (n_i,); None if there is none."""
        self.result: OwnPartsInput | None = None
        """Of its own parts at the last sample; None with halves."""
        self._halves: PairwiseFilter | None = None
        if radio.rows == "halves":
            terms = rows.pair_terms(i)
            self._halves = PairwiseFilter(i, swarm.information(), rows.qp(i), terms)
        self._terms, self._static = _terms_of_limits(rows, i), _static(swarm)
        try:
            self.own_parts = OwnParts(
                points[i].motion,
                {l: points[l].motion for l in self.with_beliefs.peers},
                function.radius,
                gain(swarm, tuple(points)),
                stamp_error=radio.stamp_error,
            )
        except ValueError as error:
            raise ScenarioError(f"{swarm.scenario.name}: {swarm.names[i]}: {error}") from error

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""
        heard, peers = self.with_beliefs.heard, self.with_beliefs.peers
        if self._halves is not None:
            present = {l: AnnouncedInput(now.t, tuple(s.u.tolist())) for l, s in heard.items()}
            halves = self._halves(replace(now, received=present))
            return replace(halves, used=[l for l in heard if l in now.received])
        whole = pair_rows(self._terms(now.x, [l for l in now.seen if l not in peers], ()), {})
        x, of_point = now.x[self._own], self._point
        z = of_point.of(x)
        result = self.result = self.own_parts(
            now.t,
            z,
            heard,
            of_point.input(x, now.u_nom),
            of_point.rows(x, whole),
            self._static(z),
            of_point.turn(x),
        )
        self.reference = of_point.at(x, self.own_parts.reference)
        u = of_point.applied(x, result.u)
        residuals = dot(whole.a, u) - whole.bound
        residual = float(residuals.max(initial=FAR))
        origin = Origin.BRAKE if result.braked else Origin.QP
        if residual > TOLERANCE:
            origin = Origin.BACKUP
        used = [l for l in heard if l in now.received and l not in self.with_beliefs.convicted]
        binding = *result.binding, *at_bound(whole, residuals)
        binding = tuple([l if l >= 0 else self._agents - 1 - l for l in binding])
        decision = Decision(u, origin, finite_or_none(residual), binding=binding)
        return Filtered(decision, used, whole)


def _terms_of_limits(rows: SafetyRows, i: int) -> OwnPairTerms:
    """Return the terms of agent i's pairs with members, and of limits: obstacles are own parts."""
    scenario = rows.swarm.scenario
    counted = np.array([0.0] * len(scenario.obstacles) + [1.0] * len(scenario.limits))
    row = partial(rows.row_function, i, rows.margin(i))
    return OwnPairTerms(rows.swarm.pairs, i, row, lambda *_: (counted,))


Static = Callable[[Array], list[tuple[float, Array]]]
"""A point (p, v) -> of each obstacle the distance to its clearance [m], and the way out of it."""


def _static(swarm: Swarm) -> Static:
    obstacles = swarm.scenario.obstacles
    if not obstacles:
        return lambda _: []
    axes = swarm.groups[0].axes
    p = ca.SX.sym("p", axes)
    rows = [ca.vertcat(o.distance(p) - o.clearance - _OFF, o.away(p)) for o in obstacles]
    evaluate = CompiledFunction([p], [ca.horzcat(*rows).T])

    def static(x: Array) -> list[tuple[float, Array]]:
        values = evaluate(x[:axes])[0].reshape(len(obstacles), -1)
        return [(float(row[0]), row[1:]) for row in values]

    return static


def gain(swarm: Swarm, agents: tuple[int, ...]) -> float:
    """Return κ [1/s] of an agent and its peers; one for all, or halves of a gap do not add up."""
    radios = [(swarm.groups[l].radio, swarm.groups[l].clock.period) for l in agents]
    if given := [radio.gain for radio, _ in radios if radio and radio.gain]:
        return min(given)
    between = max(radio.every * period for radio, period in radios if radio)
    return min(_PER_PERIOD / between, 1.0 / (math.e * max(map(swarm.horizon, agents))))
