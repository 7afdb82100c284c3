"""η by the paper's formula, from constants over the workspace: of h_tot, and of each pair alone."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.seeded.draws import Draws
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.constants import Constant, constants, margin_constants
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.obstacles import Wall

_BISECTIONS = 40
_AROUND = 10.0
"""Width of the default workspace around starts, obstacles and path [m]."""
_ANGLES = {"theta", "phi", "psi", "heading", "yaw"}


def workspace(swarm: Swarm) -> tuple[Array, Array] | list[str]:
    """Return the box's least and largest states, or the names of states without bounds."""
    given, scenario = swarm.scenario.workspace, swarm.scenario
    points = [swarm.positions(swarm.start())]
    points += [np.array([o.center]) for o in scenario.obstacles if not isinstance(o, Wall)]
    if scenario.formation:
        reach = scenario.formation.radius
        times = np.linspace(0.0, scenario.duration, 50)
        path = np.array([scenario.formation.center(t).position for t in times])
        points += [path - reach, path + reach]
    everywhere = np.concatenate(points)
    axes = dict(zip("xyz", zip(everywhere.min(0), everywhere.max(0), strict=True), strict=False))
    low, high, missing = [], [], []
    for member in swarm.members:
        for state in member.dynamics.states:
            if state in given:
                a, b = given[state]
            elif state in axes:
                a, b = axes[state][0] - _AROUND, axes[state][1] + _AROUND
            elif state in _ANGLES:
                a, b = -math.pi, math.pi
            else:
                missing.append(state)
                continue
            low.append(a)
            high.append(b)
    return sorted(set(missing)) if missing else (np.array(low), np.array(high))


def drawn_states(seed: int, purpose: str, low: Array, high: Array, count: int) -> Iterator[Array]:
    """Draw states of the box uniformly, each of shape (n̄,), by seed and purpose."""
    draws = Draws(seed, "check", purpose, width=len(low))
    return (low + (high - low) * draws[index] for index in range(count))


def states_inside(inside: Callable[[Array], Array], x: Array, drawn: Iterable[Array]) -> Array:
    """Return x(0) and drawn states, moved to the boundary of S_I if outside; shape (s, n̄)."""
    found = (y if (inside(y) <= 0).all() else boundary(inside, x, y) for y in drawn)
    return np.array([x, *found])


def boundary(inside: Callable[[Array], Array], start: Array, outside: Array) -> Array:
    """Return a state at the boundary of S_I between one inside and one outside, by bisection."""
    a, b = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (a + b) / 2
        if (inside(start + middle * (outside - start)) <= 0).all():
            a = middle
        else:
            b = middle
    return start + a * (outside - start)


class Region(NamedTuple):
    """Box in which the constants hold."""

    low: Array
    """shape (n̄,)"""
    high: Array
    samples: Array
    """States in S_I, shape (s, n̄), for constants without a bound by interval arithmetic."""


class Formula(NamedTuple):
    """The margin of one row for the longest time that any agent's input may be in force."""

    constants: dict[str, Constant]
    eta: float
    """Eq. (mainetadef), or (etaprimedef) for q > 1."""
    corrected: float
    """The same with L_φ ψ_{q-1} bounded over the workspace."""

    @property
    def proven(self) -> bool:
        """True if every constant is a bound."""
        return all(constant.how == "interval" for constant in self.constants.values())


def formula(rows: SafetyRows, chain: Chain, region: Region) -> Formula:
    """Compute η from the constants of one chain: of h_tot, or of a pair.

    Raises:
        ValueError: a member's input polytope depends on its state.
    """
    swarm, composed = rows.swarm, rows.swarm.safe_set
    places = [swarm.names.index(m.name) for m in chain.set.members]
    own = np.concatenate([np.r_[composed.parts[l]] for l in places])
    bounds = [swarm.disturbance_bounds[m.name] for m in chain.set.members]
    low, high, samples = region.low[own], region.high[own], region.samples[:, own]
    found = constants(chain, low, high, bounds, samples)
    longest = max(swarm.horizon(i) for i in swarm.normal)
    given = margin_constants(found)
    sampling, whole = given.eta(longest, 0.0), given.eta(longest, sum(bounds))
    return Formula(found, whole if chain.relative_degree == 1 else sampling, whole)


def worst_pair(rows: SafetyRows, region: Region) -> Formula:
    """Return the largest η of all pairs with a normal agent.

    Pairs of members of the same two groups have the same η.
    """
    swarm, found = rows.swarm, {}
    for number, pair in enumerate(swarm.safe_set.pairs):
        key = tuple(swarm.group_numbers[l] if l < len(swarm.groups) else l for l in pair)
        normal = any(l in swarm.normal for l in pair)
        if normal and key not in found:
            found[key] = formula(rows, rows.pair_chain(number), region)
    return max(found.values(), key=lambda f: f.corrected)
