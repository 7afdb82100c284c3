"""Mistakes in users' expressions: a value that is not finite, an input polytope that is empty.

They are looked for at x(0), and in a run wherever a step or the plant gets no number.
"""

from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.cache import cached_for
from phalanx.theory.expressions.user_methods import MistakenMethodError, first_numbers, is_built_in
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import Pair

_TOGETHER = 1024
"""Pairs evaluated at once: CasADi keeps the memory, and every forked process inherits it."""


def mistake_at(
    rows: SafetyRows, i: int, x: Array, in_sight: Sequence[int]
) -> MistakenMethodError | None:
    """Return the mistake in an expression that agent i needs at the stacked state x, shape (n̄,).

    None if there is no mistake. seen: agents whose states are known.
    """
    swarm = rows.swarm
    try:
        for l in in_sight:
            require_dynamics(swarm.members[l].dynamics, [x[swarm.safe_set.parts[l]]])
        for number, pair in enumerate(swarm.safe_set.pairs):
            if i in pair and {l for l in pair if l < len(swarm.members)} <= set(in_sight):
                _require_chain(rows, number, x)
        if i in swarm.normal:
            require_margin(rows, i, x, in_sight)
    except MistakenMethodError as mistake:
        return mistake
    return None


def require_dynamics(dynamics: Dynamics, states: Sequence[Array], where: str = "") -> None:
    """Raise MistakenMethodError unless finite at these states, shapes (n,).

    The input polytope is checked at the first. where: the states' name in the message, "the start".
    """
    evaluate, constant = cached_for([dynamics], "methods", partial(_methods, dynamics))
    for x in states:
        for method, value in zip(_METHODS, evaluate(x), strict=False):
            _require_finite(dynamics, method, x, np.array(value), where)
    A, b = map(np.array, evaluate(states[0])[-2:])
    for side in (A, b):
        _require_finite(dynamics, "input_polytope", states[0], side, where)
    if not constant:  # else it was checked when the scenario was read
        _require_polytope(dynamics, states[0], A, b, where)


_METHODS = ("drift", "actuation", "position")


def _methods(dynamics: Dynamics) -> tuple[ca.Function, bool]:
    """x -> the results of all methods, with A and b of U last; and whether U is constant."""
    x = ca.SX.sym("x", len(dynamics.states))
    values = [getattr(dynamics, method)(x) for method in _METHODS]
    sides = [ca.SX(side) for side in dynamics.input_polytope(x)]
    outputs = [ca.densify(ca.SX(value)) for value in (*values, *sides)]
    return ca.Function("f", [x], outputs), all(side.is_constant() for side in sides)


def _require_polytope(dynamics: Dynamics, x: Array, A: Array, b: Array, where: str) -> None:
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
    numbers = np.array(ca.Function("f", [chain.set.x], [ca.densify(values)])(state)).ravel()
    if not np.isfinite(numbers).all():
        got = "an h without finite derivatives" if np.isfinite(numbers[0]) else f"{numbers[0]:g}"
        raise _infinite(rows.swarm, pair, "a finite h of {}, and finite derivatives", got)


def require_margin(
    rows: SafetyRows, i: int, x: Array, in_sight: Sequence[int], where: str = ""
) -> None:
    """A user's, of normal agent i's rows with those seen. Raises MistakenMethodError.

    where: the state in words, " at the start".
    """
    swarm, margin = rows.swarm, rows.swarm.safety.margin_kind
    if is_built_in(margin):
        return
    terms = rows.pair_terms(i)(x, in_sight, swarm.sharing)
    for k in np.flatnonzero(~np.isfinite(terms.margin))[:1]:
        other = terms.others[k]
        beside = [*swarm.names, "an obstacle or a limit"][min(other, len(swarm.names))]
        expected = f"a finite margin of {swarm.names[i]} and {beside}{where}"
        raise MistakenMethodError(margin, "at_sample", expected, "no finite number")


def _infinite(swarm: Swarm, pair: Pair, expected: str, got: str) -> MistakenMethodError:
    """expected: a format with a field for the names of the pair."""
    composed = swarm.safe_set
    both = f"{composed.labels[pair.a]} and {composed.labels[pair.b]}"
    return MistakenMethodError(*composed.method_of(pair), expected.format(both), got)
