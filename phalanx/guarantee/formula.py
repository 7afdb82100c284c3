"""η by the paper's formula, from constants over the workspace: of h_tot, and of each pair alone.

The constants are those of Lemmas (constants), (psiconstants) and (xdiffbound). S as the paper gives
it is not compact, so a box is needed. A Lipschitz constant is the largest gradient norm over the
box: proven by interval arithmetic where that gives a finite bound, else estimated by the largest of
many samples of S_I.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from phalanx.network.draws import Draws
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError
from phalanx.theory.margins.margin import MarginConstants
from phalanx.theory.models.dynamics import angles
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.obstacles import Wall

_BISECTIONS = 40
_AROUND = 10.0
"""Width of the default workspace around starts, obstacles and path [m]."""
_MOST_INSTRUCTIONS = 4000
"""Larger expressions are sampled, since an interval extension would take too long."""
_USELESS = 1e9
"""An interval bound above this is too wide to use."""


def workspace(swarm: Swarm) -> tuple[Array, Array] | list[str]:
    """Return the box's least and largest states, or the names of states without bounds."""
    scenario = swarm.scenario
    points = [swarm.positions(swarm.start())]
    points += [np.array([o.center]) for o in scenario.obstacles if not isinstance(o, Wall)]
    if scenario.formation:
        reach = scenario.formation.radius
        times = np.linspace(0.0, scenario.duration, 50)
        path = np.array([scenario.formation.center(t).position for t in times])
        points += [path - reach, path + reach]
    everywhere = np.concatenate(points)
    ranges = {name: (-math.pi, math.pi) for m in swarm.members for name in angles(m.dynamics)}
    for axis, low, high in zip("xyz", everywhere.min(0), everywhere.max(0), strict=False):
        ranges[axis] = low - _AROUND, high + _AROUND
    ranges |= scenario.workspace
    states = [state for member in swarm.members for state in member.dynamics.states]
    if missing := {state for state in states if state not in ranges}:
        return sorted(missing)
    bounds = np.array([ranges[state] for state in states])
    return bounds[:, 0], bounds[:, 1]


def random_states(seed: int, purpose: str, low: Array, high: Array, count: int) -> Iterator[Array]:
    """Draw states of the box uniformly, each of shape (n̄,), by seed and purpose."""
    draws = Draws(seed, "check", purpose, width=len(low))
    return (low + (high - low) * draws[index] for index in range(count))


def states_inside(inside: Callable[[Array], Array], x: Array, states: Iterable[Array]) -> Array:
    """Return x(0) and these states, moved to the boundary of S_I if outside; shape (s, n̄)."""
    moved = (y if (inside(y) <= 0).all() else boundary(inside, x, y) for y in states)
    return np.array([x, *moved])


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


class Constant(NamedTuple):
    """One constant and its method."""

    value: float
    how: Literal["interval", "sampled"]
    """Proven by interval arithmetic, or the largest value of samples: a lower estimate."""


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

    Raises ValueError if a member's input polytope depends on its state.
    """
    swarm, composed = rows.swarm, rows.swarm.safe_set
    numbers = [swarm.names.index(m.name) for m in chain.set.members]
    states = np.concatenate([np.r_[composed.parts[l]] for l in numbers])
    bounds = [swarm.disturbance_bounds[m.name] for m in chain.set.members]
    by_name = constants(chain, Region(*[x[..., states] for x in region]), bounds)
    longest = swarm.longest_horizon
    margin = MarginConstants(**{name: constant.value for name, constant in by_name.items()})
    sampling, whole = margin.eta(longest, 0.0), margin.eta(longest, sum(bounds))
    return Formula(by_name, whole if chain.relative_degree == 1 else sampling, whole)


def worst_pair(rows: SafetyRows, region: Region) -> Formula:
    """Return the largest η of all pairs with a normal agent.

    Pairs of members of the same two groups have the same η.
    """
    swarm, formulas = rows.swarm, {}
    for number, pair in enumerate(swarm.safe_set.pairs):
        key = tuple(swarm.group_numbers[l] if l < len(swarm.groups) else l for l in pair)
        if key not in formulas:
            formulas[key] = formula(rows, rows.pair_chain(number), region)
    return max(formulas.values(), key=lambda f: f.corrected)


def constants(chain: Chain, region: Region, bounds: Sequence[float]) -> dict[str, Constant]:
    """c_f, c_g, c_alpha, c_gamma, c_h, u_max and mu of one chain, over a region of its state.

    bounds: φ_l^max of each member. Raises ValueError as formula does.
    """
    polytopes = _polytopes(chain)
    normal = [l for l, m in enumerate(chain.set.members) if not m.adversary]
    largest_input = max(float(np.linalg.norm(polytopes[l].corners, axis=1).max()) for l in normal)
    results = {"u_max": Constant(largest_input, "interval")}
    smooth = _smooth(chain, region)
    for name, norm in _norms(chain, polytopes, bounds).items():
        expression = chain.set.substitute(norm)
        bound = _by_interval(chain, expression, region) if smooth else None
        results[name] = bound or _by_samples(chain, expression, region.samples)
    return results


def _norms(
    chain: Chain, polytopes: Sequence[Polytope], bounds: Sequence[float]
) -> dict[str, ca.SX]:
    """The gradient norms whose suprema are the constants, scalars."""
    composed, x, members = chain.set, chain.set.x, chain.set.members
    c_f, c_g, c_gamma, speed = ca.SX(0), ca.SX(0), ca.SX(0), ca.SX(0)
    c_h = []
    for l, (member, part) in enumerate(zip(members, composed.parts, strict=True)):
        drift = ca.jacobian(chain.drift[l], x)
        actuation = ca.jacobian(chain.actuation[l].T, x)
        if member.adversary:
            corners = [ca.DM(v).T @ actuation + drift for v in polytopes[l].corners]
            c_gamma += ca.mmax(ca.vertcat(*[_norm(c) for c in corners]))
        else:
            c_f += _norm(drift)
            c_g += _norm(actuation)
        x_l, dynamics = x[part], member.dynamics
        rates = [
            dynamics.drift(x_l) + dynamics.actuation(x_l) @ ca.DM(v) for v in polytopes[l].corners
        ]
        fastest = ca.mmax(ca.vertcat(*[_norm(r) for r in rates])) + bounds[l]
        speed += fastest**2
        c_h.append(_norm(ca.jacobian(chain.psi[-1], x_l)))
    return {
        "c_f": c_f,
        "c_g": c_g,
        "c_alpha": _norm(ca.jacobian(chain.alpha, x)),
        "c_gamma": c_gamma,
        "c_h": ca.mmax(ca.vertcat(*c_h)),
        "mu": ca.sqrt(speed),
    }


def _norm(matrix: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(matrix))


def _smooth(chain: Chain, region: Region) -> bool:
    """Return whether h has no kink in the box, so that gradients bound differences."""
    parts = ca.vertcat(*map(ca.vec, chain.actuation), chain.drift)
    settled, x = chain.set.substitute(parts), chain.set.x
    try:
        return bool(continuous(ca.vertsplit(settled), ca.vertsplit(x), _box(region)))
    except UnboundedOperationError:
        return False


def _box(region: Region) -> list[Interval]:
    ends = zip(region.low.tolist(), region.high.tolist(), strict=True)
    return [Interval(ca.SX(a), ca.SX(b)) for a, b in ends]


def _by_interval(chain: Chain, expression: ca.SX, region: Region) -> Constant | None:
    x = chain.set.x
    if ca.Function("size", [x], [expression]).n_instructions() > _MOST_INSTRUCTIONS:
        return None
    try:
        (bound,) = extend([expression], ca.vertsplit(x), _box(region))
    except UnboundedOperationError:
        return None
    value = float(bound.hi)
    return Constant(value, "interval") if np.isfinite(value) and value < _USELESS else None


def _by_samples(chain: Chain, expression: ca.SX, samples: Array) -> Constant:
    function = ca.Function("c", [chain.set.x], [expression])
    values = np.array(function.map(len(samples))(samples.T))[0]
    if np.isnan(values).all():
        raise ValueError("a constant of the formula is not a number")
    return Constant(float(np.nanmax(values)), "sampled")


def _polytopes(chain: Chain) -> list[Polytope]:
    polytopes = []
    for member, part in zip(chain.set.members, chain.set.parts, strict=True):
        polytope = constant_polytope(*member.dynamics.input_polytope(chain.set.x[part]))
        if polytope is None:
            raise ValueError(f"expected constant input bounds of {member.name}")
        polytopes.append(polytope)
    return polytopes
