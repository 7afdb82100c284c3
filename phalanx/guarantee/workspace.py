"""The workspace of a scenario as a box of states, and states of S_I within it."""

import math
from collections.abc import Callable, Iterable, Iterator

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.scenario.model import Scenario
from phalanx.seeded.draws import Draws
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.safety.obstacles import Sphere

_BISECTIONS = 40
_AROUND = 10.0
"""How far the default workspace goes beyond starts, obstacles and path [m]."""
_ANGLES = {"theta", "phi", "psi", "heading", "yaw"}


def workspace(swarm: Swarm) -> tuple[Array, Array] | list[str]:
    """The box, or the names of states that it lacks."""
    given, scenario = swarm.scenario.workspace, swarm.scenario
    composed = swarm.safe_set
    p = CompiledFunction([composed.x], [ca.horzcat(*composed.positions).T])
    points = [p(swarm.start())[0].reshape(len(swarm.members), -1)]
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
