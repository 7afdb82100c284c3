"""What agents' sensors make of the truth: each may be wrong about its own robot's state."""

from collections import Counter, defaultdict
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.faults.strikes import Strike
from phalanx.network.distributions import quantile
from phalanx.scenario.agent_faults import SensorFault
from phalanx.seeded.draws import Draws
from phalanx.swarm.swarm import Swarm


class _Error(NamedTuple):
    """What one fault adds to what an agent is told, for a time."""

    strike: Strike
    bias: Array
    noise: Array
    """Standard deviations, shape (n_i,)."""
    draws: Draws
    fault: int

    def at(self, k: int) -> Array:
        """At sample k, shape (n_i,)."""
        drawn = [quantile("normal", float(u)) for u in self.draws[k]]
        error: Array = self.bias + self.noise * np.array(drawn)
        return error


class Sensors:
    """The sensors of all agents."""

    def __init__(self, swarm: Swarm) -> None:
        self.faults: Counter[int] = Counter()
        """Samples in which each declared fault had a part."""
        self._parts = swarm.safe_set.parts
        self._errors: defaultdict[int, list[_Error]] = defaultdict(list)
        for place, fault, strike in swarm.struck:
            if isinstance(fault, SensorFault) and not fault.silent:
                i = swarm.names.index(strike.agent)
                states = swarm.members[i].dynamics.states
                bias = np.array([fault.bias.get(state, 0.0) for state in states])
                noise = np.array([fault.noise.get(state, 0.0) for state in states])
                seed, width = swarm.scenario.seed, len(states)
                draws = Draws(seed, "fault", str(place), "noise", strike.agent, width=width)
                number = swarm.links.number(place)
                self._errors[i].append(_Error(strike, bias, noise, draws, number))

    def told(self, i: int, k: int, t: float, x: Array) -> Array:
        """What agent i is told of the stacked state x, shape (n̄,), in its sample k at t [s].

        x itself, if that is the truth.
        """
        for error in self._errors[i]:
            if error.strike.holds(t):
                x = x.copy()
                x[self._parts[i]] += error.at(k)
                self.faults[error.fault] += 1
        return x
