"""η by the paper's formula, from constants over the workspace: of h_tot, and of each pair alone."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.scenario.model import Scenario
from phalanx.seeded.draws import Draws
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.margins.constants import Constant, constants, margin_constants
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.obstacles import Sphere

_BISECTIONS = 40
_AROUND = 10.0
"""How far the default workspace goes beyond starts, obstacles and path [m]."""
_ANGLES = {"theta", "phi", "psi", "heading", "yaw"}


def workspace(swarm: Swarm) -> tuple[Array, Array] | list[str]:
    """The box, or the names of states that it lacks."""
    given, scenario = swarm.scenario.workspace, swarm.scenario
    points = [swarm.positions(swarm.start())]
    points += [np.array([o.center]) for o in scenario.obstacles if isinstance(o, Sphere)]
    if scenario.formation:
        reach = scenario.formation.radius
        path = np.array([scenario.formation.center(t).position for t in _times(scenario)])
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


def _times(scenario: Scenario) -> Array:
    return np.linspace(0.0, scenario.duration, 50)


def drawn_states(seed: int, purpose: str, low: Array, high: Array, count: int) -> Iterator[Array]:
    """States of the box, each of shape (n̄,), evenly drawn: others for each seed and purpose."""
    draws = Draws(seed, "check", purpose, width=len(low))
    return (low + (high - low) * draws[index] for index in range(count))


def states_inside(inside: Callable[[Array], Array], x: Array, drawn: Iterable[Array]) -> Array:
    """x(0) and drawn states, those outside S_I moved to its boundary; shape (s, n̄)."""
    found = (y if (inside(y) <= 0).all() else boundary(inside, x, y) for y in drawn)
    return np.array([x, *found])


def boundary(inside: Callable[[Array], Array], start: Array, outside: Array) -> Array:
    """The last state in S_I found between one inside and one outside, by bisection."""
    a, b = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (a + b) / 2
        if (inside(start + middle * (outside - start)) <= 0).all():
            a = middle
        else:
            b = middle
    return start + a * (outside - start)


class Region(NamedTuple):
    """Where the constants are to hold."""

    low: Array
    """shape (n̄,)"""
    high: Array
    samples: Array
    """States in S_I, shape (s, n̄), for constants that interval arithmetic does not bound."""


class Formula(NamedTuple):
    """The margin of one row for as long as any agent's input may be in force."""

    constants: dict[str, Constant]
    eta: float
    """Eq. (mainetadef), or (etaprimedef) for q > 1."""
    corrected: float
    """The same with L_φ ψ_{q-1} bounded over the workspace."""

    @property
    def proven(self) -> bool:
        """Whether every constant is a bound."""
        return all(constant.how == "interval" for constant in self.constants.values())


def formula(rows: SafetyRows, chain: Chain, region: Region) -> Formula:
    """η from the constants of one chain: of h_tot, or of a pair.

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
    """The pair that needs the largest margin, of those that normal agents keep rows for.

    Pairs of members of the same two groups differ in nothing that counts.
    """
    swarm, found = rows.swarm, {}
    for number, pair in enumerate(swarm.safe_set.pairs):
        groups = [id(swarm.groups[l]) for l in (pair.a, pair.b) if l is not None]
        alike = (*groups, pair.obstacle)
        normal = any(l in swarm.normal for l in (pair.a, pair.b))
        if normal and alike not in found:
            found[alike] = formula(rows, rows.pair_chain(number), region)
    return max(found.values(), key=lambda f: f.corrected)
