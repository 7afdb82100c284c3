"""Everything evaluated once at x(0), so that a mistake is said before any process starts."""

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.network.link import RuleError
from phalanx.scenario.load import ScenarioError
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm
from phalanx.swarm.watchdog import Watchdog
from phalanx.theory.expressions.asked import MistakenMethodError, in_short
from phalanx.theory.laws.law import View
from phalanx.theory.laws.nominal import NominalInput
from phalanx.theory.models.dynamics import Bounded, Dynamics, travelled
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import static_label
from phalanx.theory.safety.limits import Boundary

Array = NDArray[np.float64]

_SOON = 0.1
"""How far ahead `travel` is asked for [s]."""
_TOGETHER = 1024
"""As many pairs are evaluated at once: memory for them is kept, and every program inherits it."""


def require_runnable(swarm: Swarm) -> SafetyRows:
    """Build the rows of a run and evaluate dynamics, h, rows and laws at x(0).

    Raises:
        ScenarioError: the scenario's margin or composition cannot take its expressions; or a class
            returned what is not finite or of the wrong shape, failed, or does not return.
    """
    with Watchdog(swarm.scenario.time.timeout):
        return _runnable(swarm)


def _runnable(swarm: Swarm) -> SafetyRows:
    rows, i, x, name = build_rows(swarm), swarm.normal[0], swarm.start(), swarm.scenario.name
    first = sorted(l for l, _ in swarm.ends)
    try:
        for l in first:
            _require_dynamics(swarm.members[l].dynamics, _starts(swarm, l, x))
        _require_h(swarm, x)
        # Not all: of a large swarm no agent evaluates so many at once.
        seen = sorted({*swarm.seen(i, x), *[l for ends in swarm.ends for l in ends]})
        rows.terms(i)(x, seen).margin  # noqa: B018
        if rows.pairwise:
            rows.pair_terms(i)(x, seen)
        for l in first:
            _require_law(rows, l, x)
        _require_rules(swarm, x)
    except (MistakenMethodError, RuleError) as error:
        raise ScenarioError(f"{name}: {error}") from error
    except ValueError as error:
        raise ScenarioError(f"{name}: safety: {error}") from error
    return rows


def _starts(swarm: Swarm, l: int, x: Array) -> list[Array]:
    """x(0) of each agent of agent l's group, out of the stacked one."""
    parts = zip(swarm.groups, swarm.safe_set.parts, strict=True)
    return [x[part] for group, part in parts if group is swarm.groups[l]]


def _require_dynamics(dynamics: Dynamics, starts: list[Array]) -> None:
    """At x(0) of each agent of a group, shapes (n,); its polytope at the first one's."""
    symbol = ca.SX.sym("x", len(starts[0]))
    methods = ("drift", "actuation", "position")
    values = [ca.densify(ca.SX(getattr(dynamics, method)(symbol))) for method in methods]
    evaluate = ca.Function("f", [symbol], values)
    for x in starts:
        for method, value in zip(methods, evaluate(x), strict=True):
            _require_finite(dynamics, method, x, np.array(value))
    _require_polytope(dynamics, symbol, starts[0])
    if isinstance(dynamics, Bounded):
        for x in starts:
            travelled(dynamics, x, _SOON, 0.0)


def _require_polytope(dynamics: Dynamics, symbol: ca.SX, x: Array) -> None:
    sides = [ca.densify(ca.SX(side)) for side in dynamics.input_polytope(symbol)]
    A, b = (np.array(side) for side in ca.Function("f", [symbol], sides)(x))
    for side in (A, b):
        _require_finite(dynamics, "input_polytope", x, side)
    try:
        polytope(A, b[:, 0])
    except EmptyPolytopeError as error:
        expected = f"a compact set that is not empty at the start x = {in_short(x)}"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_finite(dynamics: Dynamics, method: str, x: Array, value: Array) -> None:
    if not np.isfinite(value).all():
        expected = f"finite numbers at the start x = {in_short(x)}"
        raise MistakenMethodError(dynamics, method, expected, in_short(value))


def _require_h(swarm: Swarm, x: Array) -> None:
    """Of every pair at the stacked x(0), shape (n̄,)."""
    pairs = swarm.pairs.among(range(len(swarm.members)))
    for few in np.array_split(pairs, 1 + len(pairs) // _TOGETHER):
        chosen = swarm.pairs.choose(few)
        h = chosen.h(x)
        for k in np.flatnonzero(~np.isfinite(h))[:1]:
            a, b = chosen.pairs[k].tolist()
            raise _infinite(swarm, a, b, f"{h[k]:g}")


def _infinite(swarm: Swarm, a: int, b: int, got: str) -> MistakenMethodError:
    """What to say of the pair of normal member a and member, obstacle or limit b."""
    composed, members = swarm.safe_set, len(swarm.members)
    function: object = swarm.scenario.safety.safe_set_function()
    static = None if b < members else composed.obstacles[b - members]
    method = "between" if static is None else "to_obstacle"
    if isinstance(static, Boundary):
        function, method = static.limit, "alone"
    other = swarm.names[b] if static is None else static_label(composed.obstacles, b - members)
    expected = f"a finite h of {swarm.names[a]} and {other} at the start"
    return MistakenMethodError(function, method, expected, got)


def _require_rules(swarm: Swarm, x: Array) -> None:
    """Of a user's own: the treatment of a first message. Raises RuleError."""
    points = swarm.positions(x)
    for sender, receiver, link in swarm.links.users_rules():
        ends = [points[swarm.names.index(name)] for name in (sender, receiver)]
        link.fate(0, 0.0, math.dist(*ends))


def _require_law(rows: SafetyRows, i: int, x: Array) -> None:
    """Agent i's first input; of a law of its own, since a law may remember what it was asked."""
    swarm = rows.swarm
    law, seen = swarm.law(i), swarm.seen(i, x)
    terms = rows.terms(i)(x, seen)
    states = {l: x[swarm.safe_set.parts[l]] for l in seen}
    normal = [l for l in swarm.normal if l in states]
    view = View(i, states, normal, swarm.goal(i)(0.0, states[i]), terms)
    NominalInput(law, swarm.members[i])(view)
