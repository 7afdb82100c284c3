"""Checks that dynamics, h and its derivatives are finite at a state.

They run at x(0) before a run, and in a run at the state where a step or the plant got no number.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.user_methods import MistakenMethodError, first_numbers
from phalanx.theory.margins.kinds import UsersMargin
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import Pair

_TOGETHER = 1024
"""Pairs evaluated at once: CasADi keeps the memory, and every forked process inherits it."""


def mistake_at(
    rows: SafetyRows, i: int, x: Array, seen: Sequence[int]
) -> MistakenMethodError | None:
    """Return the mistake in an expression that agent i needs at the stacked state x, shape (n̄,).

    None if there is no mistake. seen: agents whose states are known.
    """
    swarm = rows.swarm
    try:
        for l in seen:
            require_dynamics(swarm.members[l].dynamics, [x[swarm.safe_set.parts[l]]])
        for number, pair in enumerate(swarm.safe_set.pairs):
            if i in pair and {l for l in pair if l < len(swarm.members)} <= set(seen):
                _require_chain(rows, number, x)
        if i in swarm.normal:
            require_margin(rows, i, x, seen)
    except MistakenMethodError as mistake:
        return mistake
    return None


def require_dynamics(dynamics: Dynamics, states: Sequence[Array], where: str = "") -> None:
    """Raise MistakenMethodError unless finite at these states, shapes (n,).

    The input polytope is checked at the first. where: the states' name in the message, "the start".
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
        expected = f"a compact set that is not empty at {where}x = {first_numbers(x)}"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_finite(dynamics: Dynamics, method: str, x: Array, value: Array, where: str) -> None:
    if not np.isfinite(value).all():
        expected = f"finite numbers at {where}x = {first_numbers(x)}"
        raise MistakenMethodError(dynamics, method, expected, first_numbers(value))


def require_h(swarm: Swarm, x: Array, where: str) -> None:
    """Raise MistakenMethodError unless every pair's h is finite at the stacked x, shape (n̄,)."""
    pairs = swarm.pairs.every
    for few in np.array_split(pairs, 1 + len(pairs) // _TOGETHER):
        chosen = swarm.pairs.choose(few)
        h = chosen.h(x)
        for k in np.flatnonzero(~np.isfinite(h))[:1]:
            pair = Pair(*chosen.pairs[k].tolist())
            raise _infinite(swarm, pair, f"a finite h of {{}} {where}", f"{h[k]:g}")


def _require_chain(rows: SafetyRows, number: int, x: Array) -> None:
    """Raise MistakenMethodError unless a pair's h and the derivatives in its row are finite."""
    composed, chain = rows.swarm.safe_set, rows.pair_chain(number)
    pair = composed.pairs[number]
    values = ca.vertcat(*chain.psi, *chain.drift.nz, *[ca.vec(g) for g in chain.actuation])
    state = np.concatenate([x[composed.parts[l]] for l in pair if l < len(composed.members)])
    found = np.array(ca.Function("f", [chain.set.x], [ca.densify(values)])(state)).ravel()
    if not np.isfinite(found).all():
        got = "an h without finite derivatives" if np.isfinite(found[0]) else f"{found[0]:g}"
        raise _infinite(rows.swarm, pair, "a finite h of {}, and finite derivatives", got)


def require_margin(
    rows: SafetyRows, i: int, x: Array, seen: Sequence[int], where: str = ""
) -> None:
    """A user's, of normal agent i's rows with those seen. Raises MistakenMethodError.

    where: the state in words, " at the start".
    """
    swarm, kind = rows.swarm, rows.swarm.safety.margin_kind
    if not isinstance(kind, UsersMargin):
        return
    terms = rows.pair_terms(i)(x, seen, swarm.normal if swarm.safety.joint else ())
    for k in np.flatnonzero(~np.isfinite(terms.margin))[:1]:
        other = terms.others[k]
        beside = "an obstacle or a limit" if other is None else swarm.names[other]
        expected = f"a finite margin of {swarm.names[i]} and {beside}{where}"
        raise MistakenMethodError(kind.margin, "at_sample", expected, "no finite number")


def _infinite(swarm: Swarm, pair: Pair, expected: str, got: str) -> MistakenMethodError:
    """expected: a format with a field for the names of the pair."""
    composed = swarm.safe_set
    both = f"{composed.labels[pair.a]} and {composed.labels[pair.b]}"
    return MistakenMethodError(*composed.method_of(pair), expected.format(both), got)
