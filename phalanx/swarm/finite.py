"""Whose expression is not finite at a state: a dynamics, or h of a pair and what a row needs of it.

Before a run it is asked at x(0); in a run, where a step or the world came to no number.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.asked import MistakenMethodError, in_short
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import Pair, static_label

_TOGETHER = 1024
"""As many pairs are evaluated at once: memory for them is kept, and every program inherits it."""


def mistake_at(
    rows: SafetyRows, i: int, x: Array, seen: Sequence[int]
) -> MistakenMethodError | None:
    """What is mistaken in what agent i needs at the stacked state x, shape (n̄,); None if nothing.

    seen: whose states are known.
    """
    swarm = rows.swarm
    try:
        for l in seen:
            require_dynamics(swarm.members[l].dynamics, [x[swarm.safe_set.parts[l]]])
        for number, pair in enumerate(swarm.safe_set.pairs):
            if i in (pair.a, pair.b) and {pair.a, i if pair.b is None else pair.b} <= set(seen):
                _require_chain(rows, number, x)
    except MistakenMethodError as mistake:
        return mistake
    return None


def require_dynamics(dynamics: Dynamics, states: Sequence[Array], where: str = "") -> None:
    """At these states, shapes (n,), its polytope at the first. Raises MistakenMethodError.

    where: the states in words, "the start".
    """
    symbol = ca.SX.sym("x", len(states[0]))
    methods = ("drift", "actuation", "position")
    values = [ca.densify(ca.SX(getattr(dynamics, method)(symbol))) for method in methods]
    evaluate = ca.Function("f", [symbol], values)
    for x in states:
        for method, value in zip(methods, evaluate(x), strict=True):
            _require_finite(dynamics, method, x, np.array(value), where)
    _require_polytope(dynamics, symbol, states[0], where)


def _require_polytope(dynamics: Dynamics, symbol: ca.SX, x: Array, where: str) -> None:
    sides = [ca.densify(ca.SX(side)) for side in dynamics.input_polytope(symbol)]
    A, b = (np.array(side) for side in ca.Function("f", [symbol], sides)(x))
    for side in (A, b):
        _require_finite(dynamics, "input_polytope", x, side, where)
    try:
        polytope(A, b[:, 0])
    except EmptyPolytopeError as error:
        expected = f"a compact set that is not empty at {where}x = {in_short(x)}"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_finite(dynamics: Dynamics, method: str, x: Array, value: Array, where: str) -> None:
    if not np.isfinite(value).all():
        expected = f"finite numbers at {where}x = {in_short(x)}"
        raise MistakenMethodError(dynamics, method, expected, in_short(value))


def require_h(swarm: Swarm, x: Array, where: str) -> None:
    """Of every pair at the stacked x, shape (n̄,). Raises MistakenMethodError."""
    pairs = swarm.pairs.every
    for few in np.array_split(pairs, 1 + len(pairs) // _TOGETHER):
        chosen = swarm.pairs.choose(few)
        h = chosen.h(x)
        for k in np.flatnonzero(~np.isfinite(h))[:1]:
            a, b = chosen.pairs[k].tolist()
            beyond = b - len(swarm.members)
            pair = Pair(a, b) if beyond < 0 else Pair(a, None, beyond)
            raise _infinite(swarm, pair, f"a finite h of {{}} {where}", f"{h[k]:g}")


def _require_chain(rows: SafetyRows, number: int, x: Array) -> None:
    """Of a pair, by its number: h, and what a row needs of its derivatives."""
    composed, chain = rows.swarm.safe_set, rows.pair_chain(number)
    pair = composed.pairs[number]
    values = ca.vertcat(*chain.psi, *chain.drift.nz, *[ca.vec(g) for g in chain.actuation])
    both = [l for l in (pair.a, pair.b) if l is not None]
    state = np.concatenate([x[composed.parts[l]] for l in both])
    found = np.array(ca.Function("f", [chain.set.x], [ca.densify(values)])(state)).ravel()
    if not np.isfinite(found).all():
        got = "an h without finite derivatives" if np.isfinite(found[0]) else f"{found[0]:g}"
        raise _infinite(rows.swarm, pair, "a finite h of {}, and finite derivatives", got)


def _infinite(swarm: Swarm, pair: Pair, expected: str, got: str) -> MistakenMethodError:
    """expected: with a place for the names of the two."""
    composed = swarm.safe_set
    if pair.obstacle is None:
        other = swarm.names[pair.b or 0]
    else:
        other = static_label(composed.obstacles, pair.obstacle)
    both = f"{swarm.names[pair.a]} and {other}"
    return MistakenMethodError(*composed.asked(pair), expected.format(both), got)
