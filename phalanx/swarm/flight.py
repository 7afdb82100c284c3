"""A lone unicycle's rule: it applies an input only if it can still drive away after it, for ever.

No W is needed, as there is no other normal agent whose flight would have to be guessed. What it
flees from are members with a bounded speed; obstacles are such of no speed.
"""

from collections.abc import Sequence

import numpy as np

from phalanx.promise.exit import Chasers
from phalanx.promise.flight import Flight, Flights
from phalanx.promise.rule import Room
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.committed import flights_of, largest, reach_of
from phalanx.swarm.keep import Keeper, KeptInput, refusals_of
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.safety.function import Distance, Separation
from phalanx.theory.safety.obstacles import Sphere


class FlightKeeper:
    """Agent i's rule of commitments: the flight that it has in hand."""

    peers: tuple[int, ...] = ()
    stands = False
    flight: Flight
    """The way out in hand."""
    until: float = 0.0
    """Time from the start on for which it gets away from those that are faster [s]."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """swarm: as agent i knows it. Raises ScenarioError where nothing can be promised."""
        if refusals := refusals_of(swarm, i):
            raise ScenarioError(f"{swarm.scenario.name}: safety.keep: {refusals[0]}")
        function, spheres = swarm.safety.safe_set_function, swarm.scenario.obstacles
        assert isinstance(function, Distance | Separation)
        self._swarm, self._i, self.radius = swarm, i, function.radius
        self._flights: Flights = flights_of(swarm, i)
        self._others = [l for l in range(len(swarm.members)) if l != i]
        self._reaches = [reach_of(swarm, l) for l in self._others]
        self._centers = np.array([o.center for o in spheres if isinstance(o, Sphere)])
        clear = [o.clearance for o in spheres if isinstance(o, Sphere)]
        self._required = np.array([self.radius] * len(self._others) + clear)
        clock = swarm.groups[i].clock
        self.longest, self.shortest = swarm.horizon(i), clock.period - clock.jitter
        speeds = self._chasers(swarm.start(), 0.0).speeds + self._flights.drift
        fast = (speeds >= self._flights.speed).tolist()
        self.faster = frozenset(
            l for l, is_fast in zip(self._others, fast, strict=False) if is_fast
        )
        if self.faster:
            self.until = largest(swarm.scenario.duration, lambda time: self._best(time)[1] >= 0.0)
        self.restart()

    def __call__(self, t: float, x: Array, seen: Sequence[int], u: Array) -> KeptInput:
        """Decide on the input u, shape (m_i,), at a sample x, shape (n̄,), which shows everyone."""
        state = x[self._swarm.safe_set.parts[self._i]]
        back = self._flights.input(state, self.flight)
        # What the flight would do anyway does not end it.
        if u.tolist() == back.tolist():
            return KeptInput(back, False)
        others = self._chasers(x, max(self.until - t, 0.0))
        for flight in (self.flight, *self._flights.ways(state)):
            if (self._spare(state, u, flight, others) >= 0.0).all():
                self.flight = flight
                return KeptInput(u, True)
        return KeptInput(back, False)

    def restart(self) -> None:
        """Have the way in hand that is the best before the first sample."""
        self.flight = self._best(self.until)[0]

    def _best(self, time: float) -> tuple[Flight, float]:
        """Return the best way at the start if faster ones count for a time [s], and its room."""
        x, nothing = self._swarm.start(), np.zeros(2)
        state, others = x[self._swarm.safe_set.parts[self._i]], self._chasers(x, time)
        ways = [*self._flights.ways(state)]
        rooms = [float(self._spare(state, nothing, way, others).min()) for way in ways]
        best = int(np.argmax(rooms))
        return ways[best], rooms[best]

    def room(self, x: Array, near: object, u: Array) -> Room:
        """Return the room of the flight in hand after u, shape (m_i,), towards everyone."""
        state = x[self._swarm.safe_set.parts[self._i]]
        spare = self._spare(state, u, self.flight, self._chasers(x, self.until))
        count = len(self._others)
        return Room(np.empty(0), spare[:count], spare[count:])

    def _spare(self, state: Array, u: Array, flight: Flight, others: Chasers) -> Array:
        spare: Array = self._flights.gaps(state, u, flight, others) - self._required
        return spare

    def _chasers(self, x: Array, time: float) -> Chasers:
        """Return all others, and obstacles after them; time: for which faster ones count [s]."""
        parts, places = self._swarm.safe_set.parts, self._swarm.positions(x)[self._others]
        zeros = [(0.0, 0.0)] * len(self._centers)
        ways = [r.for_ever(x[parts[l]]) for l, r in zip(self._others, self._reaches, strict=True)]
        offsets, speeds = np.array([*ways, *zeros]).reshape(-1, 2).T
        axes = places.shape[1]
        everything = np.concatenate([places, self._centers.reshape(-1, axes)])
        return Chasers(everything, offsets, speeds, np.full(len(speeds), time))


def keeper(swarm: Swarm, i: int, true_states: bool = False) -> Keeper | FlightKeeper:
    """Return agent i's rule, as Keeper takes its arguments."""
    return FlightKeeper(swarm, i) if swarm.safety.flees else Keeper(swarm, i, true_states)
