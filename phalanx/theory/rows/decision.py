"""A normal agent's input: the QP's, else the backup LP's, Section "maxpreserve"."""

import numpy as np
from msgspec import Struct

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import LARGEST, dot, inner
from phalanx.theory.models.polytope import Polytope, minimiser
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Row, Rows, Terms
from phalanx.theory.safety.composition import FAR

AUTHORITY = 0.01
"""Least span max c_i u - min c_i u of the composed row with which an agent applies a backup."""


class Decision(Struct, frozen=True):
    """An agent's input and how it came about."""

    u: Array
    """shape (m_i,)"""
    origin: Origin
    residual: float | None
    """aᵀu - bound; at most the solver's tolerance when the row holds. None if no margin is known:
    no input satisfies such a row."""
    margin: float | None = None
    """The margin of the row, or of the row nearest to binding. None for an adversary, if no row
    binds, and if no margin is known."""
    proven: float | None = None
    """Time for which the agent has proven its pairs safe [s]; None if it proves nothing."""
    binding: tuple[int, ...] = ()
    """Whose rows the input is at the bound of, or beyond: members, or N + k for obstacle k."""


class NotANumberError(ArithmeticError):
    """A row is NaN: h or a derivative of it is undefined at this state."""


def require_numbers(*of_a_row: Array | float) -> None:
    """Raise NotANumberError if part of a row is NaN; called only if the QP has no input."""
    if any(np.isnan(value).any() for value in of_a_row):
        raise NotANumberError("the row is not a number")


def decide(
    terms: Terms,
    i: int,
    row: Row,
    u_nom: Array,
    qp: NearestInput,
    authority: float = AUTHORITY,
) -> Decision:
    """Solve agent i's QP; fall back to u_i^min, never to zero.

    Whether K_i is empty is known exactly before solving: the least aᵀu over U_i is at a vertex.

    Args:
        terms: at agent i's sampled state.
        row: the agent's row under its information model.
        u_nom: nominal input, shape (m_i,).
        authority: if max c_i u - min c_i u <= authority the backup could not help: an agent far
            from every conflict would otherwise accelerate at full throttle for nothing.

    Raises:
        NotANumberError: the row is NaN.
    """
    polytope, least = terms.polytopes[i], terms.least[i]
    solved = qp.solve(u_nom, polytope, row) if least <= row.bound else None
    if solved is not None:
        u, origin = solved, Origin.QP
    elif least <= row.bound:
        u, origin = minimiser(terms.c[i], polytope.corners), Origin.SOLVER_FAILED
    else:
        u, origin = backup(terms, i, u_nom, qp, authority)
    if origin in (Origin.SOLVER_FAILED, Origin.BACKUP):
        require_numbers(least, row.bound)
    residual = finite_or_none(max(inner(row.a.tolist(), u.tolist()) - row.bound, FAR))
    return Decision(u, origin, residual, finite_or_none(terms.margin))


def backup(
    terms: Terms, i: int, u_nom: Array, qp: NearestInput, authority: float = AUTHORITY
) -> tuple[Array, Origin]:
    """Agent i's input where K is empty, shape (m_i,); arguments as decide has them."""
    if terms.most[i] - terms.least[i] <= authority:
        u = qp.solve(u_nom, terms.polytopes[i])
        if u is not None:
            return u, Origin.NO_AUTHORITY
    return minimiser(terms.c[i], terms.polytopes[i].corners), Origin.BACKUP


def decide_pairs(polytope: Polytope, rows: Rows, u_nom: Array, qp: NearestInput) -> Decision:
    """Solve agent i's QP with one row for each pair; fall back to the least worst violation.

    The residual is that of the worst row; FAR if no pair is near, so that no row binds.
    Raises NotANumberError.
    """
    u, origin = qp.solve(u_nom, polytope, rows), Origin.QP
    if u is None:
        require_numbers(rows.a, rows.bound)
        u = qp.least_violation(polytope, rows)
        holds = (dot(rows.a, u) <= rows.bound).all()
        origin = Origin.SOLVER_FAILED if holds else Origin.BACKUP
    residuals = dot(rows.a, u) - rows.bound
    nearest = int(residuals.argmax()) if residuals.size else None
    if nearest is None or residuals[nearest] <= FAR:
        return Decision(u, origin, FAR)
    margin = None if rows.margin is None else finite_or_none(float(rows.margin[nearest]))
    residual = finite_or_none(float(residuals[nearest]))
    return Decision(u, origin, residual, margin, binding=at_bound(rows, residuals))


AT_BOUND = 1e-6
"""Slack of a row below which an input is at its bound, relative to that."""


def at_bound(rows: Rows, residuals: Array) -> tuple[int, ...]:
    """Return the others in the rows at whose bound an input is; residuals: a u - bound of each."""
    if not rows.others:
        return ()
    inside = residuals < -AT_BOUND * (1.0 + np.abs(rows.bound))  # never if not a number
    return tuple([rows.others[k] for k in np.flatnonzero(~inside).tolist()])


def finite_or_none(value: float) -> float | None:
    """The value, or None if it is infinite or nearly so."""
    return value if -LARGEST <= value <= LARGEST else None
