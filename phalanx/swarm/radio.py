"""A normal agent with a radio: what it knows of its peers, and the filter that acts on it.

It knows a peer by its newest statement, which has an age: since then the peer can have gone to any
state of a set. Two other beliefs, to compare with, take one state for the truth.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import cast

import casadi as ca
import numpy as np
from msgspec.structs import replace

from phalanx.knowledge.contradiction import contradiction
from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.own_parts import OwnParts
from phalanx.knowledge.sets import HeardState, enclosures
from phalanx.network.inbox import AnnouncedInput, Conviction, SentInput
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import StateBox
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.rows.decision import Decision, finite_or_none
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


class PeerKnowledge:
    """Agent i's knowledge of its peers, from what they broadcast of themselves."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Know the starts, as a mission's plan has them. Raises ScenarioError for its dynamics."""
        radio = swarm.groups[i].radio
        assert radio is not None
        self._belief, self._parts = radio.belief, swarm.safe_set.parts
        self.peers = swarm.peers(i)
        self.motions = {l: point_motion(swarm, l) for l in (i, *self.peers)}
        self._periods = {l: swarm.groups[l].clock.period for l in self.peers}
        start, still = swarm.start(), np.zeros(self.motions[i].axes)
        states = {l: start[self._parts[l]] for l in self.peers}
        self._newest = {l: HeardState(0.0, x, x, 0.0, still) for l, x in states.items()}
        self._begun, self._t, self._starts_known = False, 0.0, radio.starts_known
        self._stamp_error, self._said = radio.stamp_error, dict[int, ReceivedInput]()
        self.convicted: set[int] = set()
        """Peers that contradicted themselves: nothing that they state later is believed."""
        self.convictions: list[Conviction] = []
        """Those of the last sample."""
        self.heard: Mapping[int, HeardState] = {}
        """Of each peer the newest state heard; if one is taken for the truth, as if of now."""

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> tuple[Array, tuple[int, ...]]:
        """Add the states of its peers as it believes them to the stacked x, shape (n̄,), at t [s].

        received: a SentInput of each peer that was heard. Returns x and the agents in it.
        """
        if not (self._begun or (self._starts_known and t == 0.0)):
            self._newest = {}  # so does one that has taken over from an agent that died
        self._begun, self._t, x = True, t, x.copy()
        self.convictions = []
        for l, said in received.items():
            if l in self._periods and said is not self._said.get(l):
                self._said[l] = said
                self._hear(l, _heard(said))
        believed = {l: self._believed(l, heard, t) for l, heard in self._newest.items()}
        for l, state in believed.items():
            x[self._parts[l]] = state
        self.heard = self._newest
        if self._belief != "set":
            still = np.zeros(self.motions[self.peers[0]].axes)
            self.heard = {l: HeardState(t, s, s, t, still) for l, s in believed.items()}
        return x, tuple(sorted((*seen, *believed)))

    @property
    def age(self) -> Mapping[int, float]:
        """Time since the state that was heard of each peer was sampled [s]."""
        return {l: self._t - heard.t for l, heard in self._newest.items()}

    def boxes(self) -> Mapping[int, StateBox]:
        """Return for each peer the box in which its state is, by what was heard."""
        if not self._newest:
            return {}
        peers, states = zip(*self._newest.items(), strict=True)
        motions, times = [self.motions[l] for l in peers], np.full(len(peers), self._t)
        low, high = enclosures(states, times, stacked(motions), self._stamp_error)
        tubes = [np.repeat([m.tube, m.tracking.speed_tube], m.axes) for m in motions]
        return {l: (a - r, b + r) for l, a, b, r in zip(peers, low, high, tubes, strict=True)}

    def _hear(self, l: int, newer: HeardState) -> None:
        """Believe a statement of peer l, unless it contradicts the last one that was believed."""
        older, excess = self._newest.get(l), 0.0
        if older is not None and self._belief == "set":
            excess = contradiction(self.motions[l], older, newer, self._stamp_error)
        if older is not None and excess > 0.0 and l not in self.convicted:
            self.convicted.add(l)
            self.convictions.append(Conviction(l, older.t, newer.t, excess))
        if l not in self.convicted:
            self._newest[l] = newer

    def _believed(self, l: int, heard: HeardState, t: float) -> Array:
        """Return one state of peer l at t [s]; of a set the middle, where it is without input."""
        x, drag, age = heard.x, np.array([self.motions[l].drag]), max(0.0, t - heard.t)
        if self._belief == "newest":
            return x
        if self._belief == "carried-on":
            # Its input is in force until its next sample; what follows is not known.
            sure = min(age, self._periods[l])
            x, age = moved(x, heard.u, held(drag, np.array([sure]))), age - sure
        return moved(x, np.zeros(len(heard.u)), held(drag, np.array([age])))


def _heard(received: ReceivedInput) -> HeardState:
    said = cast(SentInput, received)
    return HeardState(said.t, np.array(said.x), np.array(said.z), said.t_apply, np.array(said.u))


def point_motion(swarm: Swarm, i: int) -> PointMotion:
    """Return what others know of agent i's motion. Raises ScenarioError for other dynamics."""
    dynamics, group = swarm.members[i].dynamics, swarm.groups[i]
    if not isinstance(dynamics, DoubleIntegrator):
        raise ScenarioError(
            f"{swarm.scenario.name}: agents of {swarm.names[i]}: expected a double-integrator "
            f"where there is a radio, got {group.dynamics['type']}"
        )
    return PointMotion(
        dynamics.dimension,
        dynamics.acceleration,
        dynamics.drag,
        group.disturbance.bound,
        longest=swarm.horizon(i),
        shortest=group.clock.period - group.clock.jitter,
        position_error=group.radio.position_error if group.radio else 0.0,
        speed_error=group.radio.speed_error if group.radio else 0.0,
    )


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
        motions, peers = self.with_beliefs.motions, self.with_beliefs.peers
        self._terms, self._own = rows.pair_terms(i), swarm.safe_set.parts[i]
        self._halves: PairwiseFilter | None = None
        if radio.rows == "halves":
            self._halves = PairwiseFilter(i, swarm.information(), rows.qp(i), self._terms)
        else:
            self._terms = _terms_of_limits(rows, i)
        self._static = _static(swarm)
        others = {l: motions[l] for l in peers}
        self._own_parts = OwnParts(
            motions[i],
            others,
            function.radius,
            gain(swarm, (i, *peers)),
            stamp_error=radio.stamp_error,
            position_error=radio.position_error,
            speed_error=radio.speed_error,
        )

    @property
    def reference(self) -> Array | None:
        """The reference state at the last sample, shape (n_i,); None if there is none."""
        return None if self._halves else self._own_parts.reference

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""
        heard, peers = self.with_beliefs.heard, self.with_beliefs.peers
        if self._halves is not None:
            present = {l: AnnouncedInput(now.t, tuple(s.u.tolist())) for l, s in heard.items()}
            halves = self._halves(replace(now, received=present))
            return replace(halves, used=[l for l in heard if l in now.received])
        whole = pair_rows(self._terms(now.x, [l for l in now.seen if l not in peers], ()), {})
        x = now.x[self._own]
        result = self._own_parts(now.t, x, heard, now.u_nom, whole, self._static(x))
        residual = float((dot(whole.a, result.u) - whole.bound).max(initial=FAR))
        origin = Origin.BRAKE if result.braked else Origin.QP
        if residual > TOLERANCE:
            origin = Origin.BACKUP
        used = [l for l in heard if l in now.received and l not in self.with_beliefs.convicted]
        return Filtered(Decision(result.u, origin, finite_or_none(residual)), used, whole)


def _terms_of_limits(rows: SafetyRows, i: int) -> OwnPairTerms:
    """Return the terms of agent i's pairs with members, and of limits: obstacles are own parts."""
    scenario = rows.swarm.scenario
    counted = np.array([0.0] * len(scenario.obstacles) + [1.0] * len(scenario.limits))
    row = partial(rows.row_function, i, rows.margin(i))
    return OwnPairTerms(rows.swarm.pairs, i, row, lambda *_: (counted,))


Static = Callable[[Array], list[tuple[float, Array]]]
"""State (p, v) -> of each obstacle the distance to its clearance [m], and the way out of it."""


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
