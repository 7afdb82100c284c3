"""A normal agent's rule of commitments, of the facts of its scenario.

Agent and judge run the same rule on the same samples. An input that the rule would not have let
through is found by the judge's copy, which answers it with another one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import halves
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.promise.capsules import ROUNDING, Capsules
from phalanx.promise.hold import STILL
from phalanx.promise.rule import Commitment, Room
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.committed import (
    committed_point,
    exit_velocity,
    fallback_of,
    flights_of,
    largest,
    largest_bound,
    trusted,
)
from phalanx.swarm.others import Others
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.function import Distance, Separation
from phalanx.theory.safety.obstacles import Sphere


class Refusal(NamedTuple):
    """A fact of a scenario for which no promise is made, and what to change."""

    field: str
    reason: str

    def __str__(self) -> str:
        return f"{self.field}: {self.reason}"


class KeptInput(NamedTuple):
    """The input that the rule lets through, or puts in its place."""

    u: Array
    """shape (m_i,)"""
    accepted: bool
    """Whether it is the one that was wished."""


class Keeper:
    """Agent i's rule of commitments."""

    def __init__(self, swarm: Swarm, i: int, true_states: bool = False) -> None:
        """Begin with no fallback under way. Raises ScenarioError where nothing can be promised.

        Args:
            swarm: as agent i knows it.
            true_states: whether samples are of the true motion: from one then follows how long
                nothing can come near. A sensor's next sample may differ from its last.
        """
        if refusals := refusals_of(swarm, i):
            raise ScenarioError(f"{swarm.scenario.name}: safety.keep: {refusals[0]}")
        function = swarm.safety.safe_set_function
        assert isinstance(function, Distance | Separation)
        self._swarm, self._i, self.radius = swarm, i, function.radius
        self._velocity, self._others = exit_velocity(swarm), Others(swarm, i)
        self._point, self._fallback = committed_point(swarm, i), fallback_of(swarm, i)
        self.peers, motion, exits = self._others.peers, self._fallback.motion, self._velocity
        self._farthest = np.full(len(swarm.members), np.inf)
        """By member, how far W and A of it reach from its body, at any state [m]."""
        parts, axes = swarm.safe_set.parts, np.arange(swarm.groups[i].axes)
        self._bodies = np.array([np.minimum(part.start + axes, part.stop - 1) for part in parts])
        """By member, the states that are the place of its body, shape (N, axes)."""
        self._alone_until = -np.inf
        """Until then nothing can come near enough to matter [s]."""
        if motion.jumps:
            offsets = [getattr(member.dynamics, "offset", 0.0) for member in swarm.members]
            farthest = self._others.farthest(swarm, motion.longest, exits is not None)
            self._farthest = farthest + np.array(offsets)
        self._closing, self._bounded = self._others.closing(swarm), true_states and motion.jumps
        self.commitment = Commitment(
            self._fallback, self.radius, swarm.scenario.obstacles, self._velocity
        )
        self.until = self._time_left = 0.0
        """Time from the start on for which it gets away from those that are faster [s]."""
        self.faster = frozenset[int]() if exits is None else self._as_fast(float(length(exits)))
        if self.faster:
            self.until = self._time_left = largest(swarm.scenario.duration, self._gets_away)

    def __call__(self, t: float, x: Array, seen: Sequence[int], u: Array) -> KeptInput:
        """Decide on the input u, shape (m_i,), at a sample x, shape (n̄,), of the agents seen."""
        state = x[self._swarm.safe_set.parts[self._i]]
        self._time_left = max(self.until - t, 0.0)
        own, w = self._point.of_both(state, u)
        begins, fallback = self.commitment.begins, self.commitment.fallback_input(t, own)
        back = None if begins else self._point.applied(state, fallback)
        # What the fallback would do anyway does not end it.
        same = w.tolist() == fallback.tolist() if back is None else u.tolist() == back.tolist()
        accepted = not same and self._accepts(t, x, seen, own, w)
        self.commitment.follow(accepted)
        if accepted:
            return KeptInput(u, True)
        return KeptInput(self._point.applied(state, fallback) if back is None else back, False)

    def _as_fast(self, speed: float) -> frozenset[int]:
        """Return the members that keep no rule and are as fast as the exit."""
        swarm, x = self._swarm, self._swarm.start()
        members = np.arange(len(swarm.members))
        chasers = self._others.chasers(members, x, swarm.positions(x), 0.0)
        kept_from = [l for l in members.tolist() if l != self._i and l not in self.peers]
        fast = (chasers.speeds >= speed).tolist()
        return frozenset(l for l, is_fast in zip(kept_from, fast, strict=True) if is_fast)

    def _gets_away(self, time: float) -> bool:
        """Return whether it gets away from all that are faster, for a time from the start on."""
        self._time_left, x = time, self._swarm.start()
        nothing = np.zeros(len(self._swarm.members[self._i].dynamics.inputs))
        room = self.room(x, np.array([self._i, *sorted(self.faster)], dtype=np.intp), nothing)
        return bool((room.members >= 0.0).all())

    def _accepts(self, t: float, x: Array, seen: Sequence[int], own: Array, w: Array) -> bool:
        """Return whether w leaves room, towards those that are near enough to matter."""
        if t < self._alone_until:
            return True
        members, (p, _) = np.array(seen, dtype=np.intp), halves(own)
        extent, ways = self._fallback.extent(own, w), x[self._bodies[members]] - p
        away = length(ways) - self._farthest[members] - self.radius - ROUNDING
        near = members[~(away > extent)]
        if self._velocity is None and near.tolist() == [self._i]:
            free = self.commitment.obstacles.gap(p)
            if self._bounded:
                self._alone_until = t + self._time_alone(away, free, members)
            if free > extent:
                return True
        return self._room(x, near, self._swarm.positions(x), own, w).least >= 0.0

    def _time_alone(self, away: Array, free: float, members: Index) -> float:
        """Return how long nothing can come near, whatever all do [s]."""
        motion = self._fallback.motion
        assert isinstance(motion, VelocityMotion)
        fastest = np.array([motion.fastest])
        widest, closing = self._fallback.extent(fastest, fastest), self._closing[members]
        times = (away - widest) / closing
        times[members == self._i] = (free - widest) / closing[members == self._i]
        return float(np.minimum.reduce(times))

    def room(self, x: Array, near: Index, u: Array) -> Room:
        """Return the room of the tube after u, shape (m_i,), towards the members that are near."""
        state, places = x[self._swarm.safe_set.parts[self._i]], self._swarm.positions(x)
        return self._room(x, near, places, *self._point.of_both(state, u))

    def _room(self, x: Array, near: Index, places: Array, own: Array, w: Array) -> Room:
        expected = self._others.expected(near, x, places)
        if self._velocity is not None:
            chasers = self._others.chasers(near, x, places, self._time_left)
            return self.commitment.room(own, w, expected, chasers)
        time = self._fallback.rest_time(own, w)
        reached = self._others.reached(near, x, places, time)
        return self.commitment.room(own, w, expected, reached)

    def tube(self, x: Array, u: Array) -> Capsules:
        """Return T of the input u, shape (m_i,), at x, shape (n̄,)."""
        state = x[self._swarm.safe_set.parts[self._i]]
        return self._fallback.tube(*self._point.of_both(state, u))

    @property
    def longest(self) -> float:
        """Longest gap that it counts on [s]."""
        return self._fallback.motion.longest

    @property
    def shortest(self) -> float:
        """Shortest gap that it counts on [s]."""
        return 0.0 if self._fallback.motion.jumps else self._fallback.motion.shortest

    def restart(self) -> None:
        """Forget the fallback under way: another process has taken over."""
        self.commitment.reference = None

    @property
    def stands(self) -> bool:
        """True if its reference is at rest."""
        reference = self.commitment.reference
        return reference is not None and float(length(halves(reference.z)[1])) <= STILL


def refusals_of(swarm: Swarm, i: int) -> list[Refusal]:
    """Return why nothing can be promised to agent i, by field; empty if nothing is in the way."""
    safety, refusals = swarm.safety, list[Refusal]()
    if not isinstance(safety.safe_set_function, Distance | Separation):
        what = "expected 'distance' or 'separation': a promise keeps a distance of output points"
        refusals.append(Refusal("safety.function", what))
    if swarm.time.latency > 0.0:
        what = "expected 0: an input that is decided and not yet applied is not counted"
        refusals.append(Refusal("time.latency", what))
    if swarm.scenario.limits:
        what = "expected none: write a wall as an obstacle, which the rule keeps clear of"
        refusals.append(Refusal("limits", what))
    if safety.leaves:
        refusals += _of_leaving(swarm, i)
    kinds = {swarm.group_numbers[l]: l for l in (*reversed(trusted(swarm, i)), i)}
    for l in () if refusals else sorted(kinds.values(), key=lambda l: l != i):
        refusals += _of_agent(swarm, l)
    for l in (first if first != i else last for first, last in swarm.ends):
        if l != i and not isinstance(swarm.members[l].dynamics, Bounded):
            what = f"expected dynamics with `travel`, which bound how far {swarm.names[l]} can get"
            refusals.append(Refusal(f"dynamics of {swarm.names[l]}", what))
    return refusals or ([] if safety.leaves else _blind(swarm, i))


def _of_leaving(swarm: Swarm, i: int) -> list[Refusal]:
    """Return what is in the way of leaving: with one velocity, or of a lone unicycle's flight."""
    axes, refusals, dynamics = swarm.groups[i].axes, list[Refusal](), swarm.members[i].dynamics
    velocity, of_agent = swarm.safety.exit_velocity, f"dynamics of {swarm.names[i]}"
    if velocity is None:
        if len(swarm.normal) > 1:
            what = "expected one: others would have to guess where it flees"
            refusals.append(Refusal("normal agents", what))
        if not isinstance(dynamics, Unicycle):
            refusals.append(Refusal(of_agent, "expected a unicycle; others have hold and exit"))
    elif len(velocity) != axes:
        refusals.append(Refusal("exit", f"expected {axes} numbers, got {len(velocity)}"))
    elif not isinstance(dynamics, SingleIntegrator | DoubleIntegrator):
        what = "expected a single- or double-integrator; a lone unicycle has keep = 'flight'"
        refusals.append(Refusal(of_agent, what))
    if not all(isinstance(obstacle, Sphere) for obstacle in swarm.scenario.obstacles):
        refusals.append(Refusal("obstacles", "expected spheres, which an exit can be kept from"))
    if swarm.sensing(i) is not None:
        what = "expected none: who comes from ahead is met at any distance"
        refusals.append(Refusal(f"sensing of {swarm.names[i]}", what))
    return refusals


def _of_agent(swarm: Swarm, l: int) -> list[Refusal]:
    """Return what is in the way of agent l's own fallback."""
    name = swarm.names[l]
    if swarm.groups[l].radio is not None:
        what = "expected none: the rule judges states that are seen, not heard"
        return [Refusal(f"radio of {name}", what)]
    if name in swarm.scenario.programs_by_zenoh():
        return [Refusal(f"protocol of {name}", "expected 'stdio': by Zenoh it keeps no rule")]
    try:
        flights_of(swarm, l) if swarm.safety.flees else fallback_of(swarm, l)
    except ScenarioError as error:
        return [Refusal(f"dynamics of {name}", f"expected {str(error).partition('expected ')[2]}")]
    except ValueError as error:
        most = _largest_bound(swarm, l)
        enough = f"at most {most:.3g} would do" if most > 0.0 else "none would do"
        return [Refusal(f"disturbance.bound of {name}", f"{error}; {enough}")]
    return []


def _largest_bound(swarm: Swarm, l: int) -> float:
    model = swarm.members[l].dynamics
    if swarm.safety.flees and isinstance(model, Unicycle):
        return model.turn_rate
    return largest_bound(swarm, l)


def _blind(swarm: Swarm, i: int) -> list[Refusal]:
    """Return whether others may come from beyond agent i's sight too fast."""
    sight, least = swarm.sensing(i), least_sight(swarm, i)
    if sight is None or (least is not None and sight >= least):
        return []
    what = "expected none: others' speeds have no bound"
    if least is not None:
        what = f"expected at least {least:.3g} m, got {sight:g}: others may come from beyond"
    return [Refusal(f"sensing of {swarm.names[i]}", what)]


def least_sight(swarm: Swarm, i: int) -> float | None:
    """Return how far agent i has to see to know of all that its tubes may meet [m].

    None if there is no such distance, as speeds are unbounded.
    """
    fallback, function = fallback_of(swarm, i), swarm.safety.safe_set_function
    assert isinstance(function, Distance | Separation)
    if not fallback.motion.jumps:
        return None
    farthest = float(Others(swarm, i).farthest(swarm, fallback.motion.longest, False).max())
    own = fallback.expected(np.zeros((1, 2 * swarm.groups[i].axes)))
    return function.radius + float(own.radius[0]) + farthest if farthest < np.inf else None
