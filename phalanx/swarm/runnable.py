"""Everything evaluated once at x(0), so that a mistake is said before any process starts."""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.scenario.load import ScenarioError
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.asked import MistakenMethodError, ask
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Bounded, Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import static_label
from phalanx.theory.safety.limits import Boundary

Array = NDArray[np.float64]

_SOON = 0.1
"""How far ahead `travel` is asked for [s]."""


def require_runnable(swarm: Swarm) -> SafetyRows:
    """Build the rows of a run and evaluate dynamics, h, rows and laws at x(0).

    Raises:
        ScenarioError: the scenario's margin or composition cannot take its expressions; or a class
            returned what is not finite or of the wrong shape, or failed.
    """
    rows, i, x, name = build_rows(swarm), swarm.normal[0], swarm.start(), swarm.scenario.name
    first = {id(group): l for l, group in reversed(list(enumerate(swarm.groups)))}
    try:
        for l, part in enumerate(swarm.safe_set.parts):
            _require_dynamics(swarm.members[l].dynamics, x[part], l in first.values())
        _require_h(swarm, x)
        rows.terms(i)(x).margin  # noqa: B018
        if rows.pairwise:
            rows.pair_terms(i)(x)
        for l in sorted(first.values()):
            _require_law(rows, l, x)
    except MistakenMethodError as error:
        raise ScenarioError(f"{name}: {error}") from error
    except ValueError as error:
        raise ScenarioError(f"{name}: safety: {error}") from error
    return rows


def _require_dynamics(dynamics: Dynamics, x: Array, first: bool) -> None:
    """At one agent's x(0), shape (n,); the `first` of a group is asked for its polytope too."""
    symbol = ca.SX.sym("x", len(x))
    methods = ("drift", "actuation", "position")
    values = [ca.densify(ca.SX(getattr(dynamics, method)(symbol))) for method in methods]
    at_start = ca.Function("f", [symbol], values)(x)
    for method, value in zip(methods, at_start, strict=True):
        _require_finite(dynamics, method, x, np.array(value))
    if first:
        sides = [ca.densify(ca.SX(side)) for side in dynamics.input_polytope(symbol)]
        A, b = (np.array(side) for side in ca.Function("f", [symbol], sides)(x))
        for side in (A, b):
            _require_finite(dynamics, "input_polytope", x, side)
        try:
            polytope(A, b[:, 0])
        except EmptyPolytopeError as error:
            expected = f"a compact set that is not empty at the start x = {_short(x)}"
            raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error
    if isinstance(dynamics, Bounded):
        distance: Any = ask(dynamics, "travel", "a distance [m]", x, _SOON, 0.0)
        if not isinstance(distance, int | float) or not distance >= 0.0:
            raise MistakenMethodError(dynamics, "travel", "a distance [m]", repr(distance))


def _require_finite(dynamics: Dynamics, method: str, x: Array, value: Array) -> None:
    if not np.isfinite(value).all():
        expected = f"finite numbers at the start x = {_short(x)}"
        raise MistakenMethodError(dynamics, method, expected, _short(value))


def _require_h(swarm: Swarm, x: Array) -> None:
    """Of every pair at the stacked x(0), shape (n̄,)."""
    members = len(swarm.members)
    chosen = swarm.pairs.choose(swarm.pairs.among(range(members)))
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


def _require_law(rows: SafetyRows, i: int, x: Array) -> None:
    """Agent i's first input; of a law of its own, since a law may remember what it was asked."""
    swarm = rows.swarm
    law, seen = swarm.law(i, fresh=True), swarm.seen(i, x)
    terms = rows.terms(i)(x, seen)
    states = {l: x[swarm.safe_set.parts[l]] for l in seen}
    normal = [l for l in swarm.normal if l in states]
    view = View(i, states, normal, swarm.goal(i)(0.0, states[i]), terms)
    m = len(swarm.members[i].dynamics.inputs)
    expected = f"an array of {m} finite numbers for agent {swarm.names[i]}"
    found = ask(law, "input", expected, view)
    if not isinstance(found, np.ndarray):
        raise MistakenMethodError(law, "input", expected, repr(found))
    if found.shape != (m,) or found.dtype.kind not in "fi":
        raise MistakenMethodError(law, "input", expected, f"shape {found.shape} of {found.dtype}")
    if not np.isfinite(found).all():
        raise MistakenMethodError(law, "input", expected, _short(found))


def _short(value: Array) -> str:
    """Its first numbers."""
    shown = ", ".join(f"{number:.4g}" for number in value.ravel()[:6])
    return f"({shown}{', ...' if value.size > 6 else ''})"
