"""A normal agent's rule of commitments, of the facts of its scenario.

Agent and judge run the same rule on the same samples. An input that the rule would not have let
through is found by the judge's copy, which answers it with another one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import halves
from phalanx.promise.capsules import ROUNDING, Capsules, joined
from phalanx.promise.exit import Chasers
from phalanx.promise.hold import STILL
from phalanx.promise.rule import Commitment, Room
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.committed import (
    committed_point,
    exit_velocity,
    fallback_of,
    largest_bound,
    reach_of,
    trusted,
)
from phalanx.swarm.points import MovedByVelocity
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
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

    def __init__(self, swarm: Swarm, i: int) -> None:
        """swarm: as agent i knows it. Raises ScenarioError where nothing can be promised."""
        if refusals := refusals_of(swarm, i):
            raise ScenarioError(f"{swarm.scenario.name}: safety.keep: {refusals[0]}")
        function = swarm.safety.safe_set_function
        assert isinstance(function, Distance | Separation)
        self._swarm, self._i, self.radius = swarm, i, function.radius
        self.peers, self._velocity = trusted(swarm, i), exit_velocity(swarm)
        self._points = {l: committed_point(swarm, l) for l in (i, *self.peers)}
        self._fallbacks = {l: fallback_of(swarm, l) for l in (i, *self.peers)}
        self._reaches = {l: reach_of(swarm, l) for l in range(len(swarm.members)) if l != i}
        self._far = np.array([self._farthest(l) for l in range(len(swarm.members))])
        """By member, how far it reaches in what counts of it, at any state [m]."""
        self.commitment = Commitment(
            self._fallbacks[i], self.radius, swarm.scenario.obstacles, self._velocity
        )

    def __call__(self, t: float, x: Array, seen: tuple[int, ...], u: Array) -> KeptInput:
        """Decide on the input u, shape (m_i,), at a sample x, shape (n̄,), of the agents seen."""
        state, point = x[self._swarm.safe_set.parts[self._i]], self._points[self._i]
        back = point.applied(state, self.commitment.fallback_input(t, point.of(state)))
        # What the fallback would do anyway does not end it.
        accepted = not np.array_equal(u, back) and self._accepts(x, seen, u)
        self.commitment.follow(accepted)
        return KeptInput(u if accepted else back, accepted)

    def _accepts(self, x: Array, seen: tuple[int, ...], u: Array) -> bool:
        """Return whether u leaves room, towards those that are near enough to matter."""
        tube, places = self.tube(x, u), self._swarm.positions(x)
        p = places[self._i]
        ends = np.maximum(length(tube.begin - p), length(tube.end - p)) + tube.radius
        reach = float(np.maximum.reduce(ends))
        away = length(places - p) - self._far
        close = np.flatnonzero(~(away > self.radius + reach + ROUNDING)).tolist()
        near = tuple([l for l in close if l in seen])
        if not near and self._velocity is None and self.commitment.obstacles.far(p, reach):
            return True
        return self.room(x, near, u).least >= 0.0

    def _farthest(self, l: int) -> float:
        """Bound on how far from member l's output point W and A reach [m]."""
        swarm, x = self._swarm, self._swarm.start()
        if l == self._i:
            return -np.inf
        bounded = isinstance(swarm.members[l].dynamics, MovedByVelocity)
        chases = self._velocity is not None and l not in self.peers
        if not bounded or chases or not self._fallbacks[self._i].motion.jumps:
            return np.inf
        part, p = swarm.safe_set.parts[l], swarm.positions(x)[l]
        time = self._fallbacks[self._i].motion.longest
        reaches = [self._reaches[l].within(x[part], p, time)] if self._velocity is None else []
        reaches += [self.expected(l, x)] if l in self.peers else []
        return max(float(reach.radius[0]) for reach in reaches)

    def room(self, x: Array, seen: tuple[int, ...], u: Array) -> Room:
        """Return the room of the tube after u, shape (m_i,)."""
        swarm, i = self._swarm, self._i
        parts, places = swarm.safe_set.parts, swarm.positions(x)
        own, axes = self._points[i].of(x[parts[i]]), places.shape[1]
        w = self._points[i].input(x[parts[i]], u)
        expected = [self.expected(l, x) for l in seen if l in self.peers]
        members: Capsules | Chasers
        if self._velocity is None:
            time = self._fallbacks[i].rest_time(own, w)
            others = [l for l in seen if l != i]
            reaches = [self._reaches[l].within(x[parts[l]], places[l], time) for l in others]
            members = joined(reaches, axes)
        else:
            members = self._chasers([l for l in seen if l != i and l not in self.peers], x, places)
        return self.commitment.room(own, w, joined(expected, axes), members)

    def _chasers(self, others: Sequence[int], x: Array, places: Array) -> Chasers:
        """Return all that keep no rule, each where its offset brings it nearest."""
        parts = self._swarm.safe_set.parts
        ways = [self._reaches[l].for_ever(x[parts[l]]) for l in others]
        offsets, speeds = np.array(ways).reshape(-1, 2).T
        return Chasers(places[list(others)], offsets, speeds)

    def tube(self, x: Array, u: Array) -> Capsules:
        """Return T of the input u, shape (m_i,), at x, shape (n̄,)."""
        state, point = x[self._swarm.safe_set.parts[self._i]], self._points[self._i]
        return self._fallbacks[self._i].tube(point.of(state), point.input(state, u))

    def expected(self, l: int, x: Array) -> Capsules:
        """Return W of a peer."""
        state = x[self._swarm.safe_set.parts[l]]
        return self._fallbacks[l].expected(self._points[l].of(state))

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
    if (velocity := safety.exit_velocity) is not None:
        refusals += _of_exit(swarm, i, velocity)
    for l in () if refusals else (i, *trusted(swarm, i)):
        refusals += _of_agent(swarm, l)
    for l, member in enumerate(swarm.members):
        if l != i and not isinstance(member.dynamics, Bounded):
            what = f"expected dynamics with `travel`, which bound how far {member.name} can get"
            refusals.append(Refusal(f"dynamics of {member.name}", what))
    return refusals or _blind(swarm, i)


def _of_exit(swarm: Swarm, i: int, velocity: tuple[float, ...]) -> list[Refusal]:
    """Return what is in the way of leaving with one velocity."""
    axes, refusals = swarm.groups[i].axes, list[Refusal]()
    if len(velocity) != axes:
        refusals.append(Refusal("exit", f"expected {axes} numbers, got {len(velocity)}"))
    dynamics = swarm.members[i].dynamics
    if not isinstance(dynamics, SingleIntegrator | DoubleIntegrator):
        what = "expected a single- or double-integrator: a unicycle has no velocity at any heading"
        refusals.append(Refusal(f"dynamics of {swarm.names[i]}", what))
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
        fallback_of(swarm, l)
    except ScenarioError as error:
        return [Refusal(f"dynamics of {name}", f"expected {str(error).partition('expected ')[2]}")]
    except ValueError as error:
        most = largest_bound(swarm, l)
        enough = f"at most {most:.3g} would do" if most > 0.0 else "none would do"
        return [Refusal(f"disturbance.bound of {name}", f"{error}; {enough}")]
    return []


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
    others = [l for l in range(len(swarm.members)) if l != i]
    if not all(isinstance(swarm.members[l].dynamics, MovedByVelocity) for l in (i, *others)):
        return None
    function, x = swarm.safety.safe_set_function, swarm.start()
    assert isinstance(function, Distance | Separation)
    parts, places, peers = swarm.safe_set.parts, swarm.positions(x), trusted(swarm, i)
    expected = {
        l: fallback_of(swarm, l).expected(committed_point(swarm, l).of(x[parts[l]]))
        for l in (i, *peers)
    }
    time = fallback_of(swarm, i).motion.longest
    reaches = [reach_of(swarm, l).within(x[parts[l]], places[l], time) for l in others]
    farthest = max([float(r.radius[0]) for r in (*reaches, *expected.values())])
    return function.radius + float(expected[i].radius[0]) + farthest
