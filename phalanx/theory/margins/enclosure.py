"""Picard enclosures in interval arithmetic: boxes that contain an agent's state for a while."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import (
    Interval,
    add,
    exponential,
    finite,
    hull,
    inflate,
    inside,
    intersection,
    multiply,
    point,
    reciprocal,
)
from phalanx.theory.expressions.rounding import rounds_outwards
from phalanx.theory.models.polytope import constant_polytope, vertices
from phalanx.theory.safety.composition import ComposedSet, Member

_LEAST = 1e-9


class Enclosure(NamedTuple):
    """One member's motion within the horizon: symbols, and intervals that contain them."""

    x: ca.SX
    """The state, shape (n,)."""
    u: ca.SX
    """The input in force, shape (m,)."""
    phi: ca.SX
    """The disturbance, shape (n,)."""
    rate: ca.SX
    """f + g u, which is x' but for φ, shape (n,)."""
    states: list[Interval]
    """The box B, which contains every state from the sample to the horizon."""
    inputs: list[Interval]
    disturbances: list[Interval]
    certain: ca.SX
    """1 if x(t) provably stays in `states` until the horizon, else 0."""


def enclose(
    member: Member,
    x: ca.SX,
    inputs: Sequence[Interval] | None,
    bound: float,
    horizon: float | ca.SX,
    inflations: Sequence[float],
) -> Enclosure:
    """A box that contains x(t) for all t up to the horizon, and a proof of that as an expression.

    If x^k + [0, τ] F(B) lies in B, where F bounds x' over B, and x^k inside B, then x(t) cannot
    leave B by τ: when it left, it would still be between a point inside and one in B, so inside.
    For a component that drag slows down, a second bound is tighter.

    Args:
        member: the moving member; its dynamics contain its own state only.
        x: its sampled state, symbols, shape (n,).
        inputs: range of each of its inputs, at any time; None for one held input u, on whose
            symbols the intervals then depend.
        bound: φ^max.
        horizon: τ [s].
        inflations: share by which the box is widened, for each round; more rounds allow a longer
            horizon.

    Raises:
        UnboundedOperationError: its dynamics have no interval extension.
    """
    u = ca.SX.sym(f"u_{member.name}", len(member.dynamics.inputs))
    phi = ca.SX.sym(f"phi_{member.name}", len(member.dynamics.states))
    undisturbed = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u
    rate = undisturbed + phi
    pushed = [Interval(ca.SX(-bound), ca.SX(bound)) for _ in member.dynamics.states]
    allowed = [point(c) for c in ca.vertsplit(u)] if inputs is None else list(inputs)
    symbols = scalars([x, u, phi])
    starts = [point(component) for component in ca.vertsplit(x)]

    # The margins of rows, rounded to nearest, do not use the bound with drag.
    drag = ca.diag(ca.jacobian(rate, x)) if rounds_outwards() else ca.SX.zeros(x.numel())
    slowed = [k for k in range(x.numel()) if not drag[k].is_zero()]

    # One round as a CasADi function, which is expanded faster than Python code.
    ends = [Interval(*ca.vertsplit(ca.SX.sym("end", 2))) for _ in starts]
    moving = [*ends, *allowed, *pushed]
    rates = extend(ca.vertsplit(rate), symbols, moving)
    reached = moved(x, rates, horizon)
    for k in slowed:
        reached[k] = intersection(reached[k], _slowed(k, x, rate, symbols, moving, horizon))
    arguments = [x, u, ca.vertcat(*ca.symvar(ca.SX(horizon)))]
    one_round = ca.Function(
        "round", [*arguments, *_sides(ends)], [*_sides(reached), *_sides(rates)]
    )

    def after(box: Sequence[Interval]) -> tuple[list[Interval], list[Interval]]:
        """States reached by the horizon if the state stays in the box, and the rates in it."""
        low, high, least, most = map(ca.vertsplit, one_round.call([*arguments, *_sides(box)]))
        return list(map(Interval, low, high)), list(map(Interval, least, most))

    box = starts
    for extra in inflations:
        ends, _ = after(box)
        hulls = [hull(a, b) for a, b in zip(starts, ends, strict=True)]
        box = [inflate(interval, extra, _LEAST) for interval in hulls]
    final, last = after(box)
    certain = finite(last)
    for start, a, b in zip(starts, final, box, strict=True):
        within = ca.logic_and(b.lo < start.lo, start.hi < b.hi)  # false where 1e-9 is rounded off
        certain = ca.logic_and(certain, ca.logic_and(within, inside(a, b)))
    return Enclosure(x, u, phi, undisturbed, final, allowed, pushed, certain)


def enclose_all(
    composed: ComposedSet,
    bounds: Sequence[float],
    horizon: float | ca.SX,
    inflations: Sequence[float],
    held: int | None = None,
) -> list[Enclosure]:
    """Enclose the motions of all members; arguments and errors as enclose has them.

    held: the index of a member that holds one input; the others apply any of U.
    """
    enclosures = []
    for l, member in enumerate(composed.members):
        x, inputs = composed.x[composed.parts[l]], None if l == held else admissible_inputs(member)
        enclosures.append(enclose(member, x, inputs, bounds[l], horizon, inflations))
    return enclosures


def _sides(box: Sequence[Interval]) -> list[ca.SX]:
    """The lower ends as a column, and the upper ends."""
    return [ca.vertcat(*side) for side in zip(*box, strict=True)]


def _slowed(
    k: int,
    x: ca.SX,
    rate: ca.SX,
    symbols: Sequence[ca.SX],
    box: Sequence[Interval],
    horizon: float | ca.SX,
) -> Interval:
    """Range of x_k while the state is in the box, with its own drag; unbounded if not proven.

    If its rate is continuous with ∂rate/∂x_k <= j, it grows by d > 0 at a rate of at most a + j d,
    a the largest over the box with x_k as at the start: d <= a (e^{jτ} - 1) / j, with a > 0, which
    is at most a τ e^{jτ} for j >= 0 and a min(τ, 1/|j|) for j < 0. Downwards likewise. No drag is
    too strong, since a does not depend on the box of x_k.

    Args:
        k: which component.
        x: the state at the start, symbols, shape (n,).
        rate: x', shape (n,).
        symbols: of the rate, x first.
        box: their intervals.
        horizon: τ [s].
    """
    slope, start = ca.jacobian(rate[k], x[k]), point(x[k])
    (steepness,) = extend([slope], symbols, box)
    (begin,) = extend([rate[k]], symbols, [*box[:k], start, *box[k + 1 :]])
    rising = exponential(multiply(point(horizon), point(ca.fmax(0, steepness.hi))))
    falling = ca.if_else(steepness.hi < 0, reciprocal(point(-steepness.hi)).hi, ca.inf)
    time = ca.fmin(multiply(point(horizon), rising).hi, falling)
    reach = add(start, hull(point(0.0), multiply(point(time), begin)))
    proven = ca.logic_and(steepness.hi < ca.inf, continuous([rate[k]], symbols, box))
    return Interval(ca.if_else(proven, reach.lo, -ca.inf), ca.if_else(proven, reach.hi, ca.inf))


def fastest(member: Member, inputs: Sequence[Interval], bound: float) -> list[Interval] | None:
    """Range of x' over all states; None if it is unbounded.

    Args:
        member: the moving member.
        inputs: range of each of its inputs.
        bound: φ^max.

    Raises:
        UnboundedOperationError: its dynamics have no interval extension.
    """
    x = ca.SX.sym("x", len(member.dynamics.states))
    u = ca.SX.sym("u", len(member.dynamics.inputs))
    rate = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u
    anywhere = [Interval(ca.SX(-ca.inf), ca.SX(ca.inf))] * x.numel()
    undisturbed = extend(ca.vertsplit(rate), scalars([x, u]), [*anywhere, *inputs])
    pushed = Interval(ca.SX(-bound), ca.SX(bound))
    rates = [add(rate_range, pushed) for rate_range in undisturbed]
    return (
        rates
        if np.isfinite([float(end) for rate_range in rates for end in rate_range]).all()
        else None
    )


def moved(x: ca.SX, rates: Sequence[Interval], horizon: float | ca.SX) -> list[Interval]:
    """x + [0, τ] rates, by component; NaN as a rate is ignored."""
    time = point(horizon)
    return [
        add(point(start), hull(point(0.0), multiply(time, rate)))
        for start, rate in zip(ca.vertsplit(x), rates, strict=True)
    ]


def admissible_inputs(member: Member) -> list[Interval]:
    """The box around all inputs that an actuator accepts.

    Raises:
        ValueError: U depends on the state.
    """
    corners = admissible_corners(member)
    ends = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
    return [Interval(ca.SX(a), ca.SX(b)) for a, b in ends.tolist()]


def admissible_corners(member: Member) -> Array:
    """Vertices of the set that an actuator accepts, U with every face moved out, shape (v, m).

    Raises:
        ValueError: U depends on the state.
    """
    x = ca.SX.sym("x", len(member.dynamics.states))
    polytope = constant_polytope(*member.dynamics.input_polytope(x))
    if polytope is None:
        raise ValueError(
            f"safety.margin: expected input bounds of {member.name} that do not depend on its "
            "state, which the local margin needs"
        )
    # Vertices are rounded to nearest; the factor covers that.
    share = 1.0 + 1e-6 if rounds_outwards() else 1.0
    return vertices(polytope.A, polytope.b + share * polytope.allowance)


class Within(NamedTuple):
    """All that a row and its rate depend on until the horizon, each with its range."""

    fixed: list[ca.SX]
    """w_l of each member in agent i's row: its own input, and for others a fixed one in U_l, which
    is not the input that moves the member's state."""
    symbols: list[ca.SX]
    intervals: list[Interval]


def within(
    moving: Sequence[Enclosure], i: int, constants: Sequence[ca.SX], values: Sequence[ca.SX]
) -> Within:
    """Collect symbols and ranges of the row of member i.

    constants: scalars that do not change until the horizon, with their values at the sample.
    """
    fixed = [e.u if l == i else ca.SX.sym("w", e.u.numel()) for l, e in enumerate(moving)]
    others = [l for l in range(len(moving)) if l != i]
    vectors = [*[e.x for e in moving], *[e.u for e in moving], *[fixed[l] for l in others]]
    ranges = [*[e.states for e in moving], *[e.inputs for e in moving]]
    ranges += [moving[l].inputs for l in others]
    ranges += [e.disturbances for e in moving]
    return Within(
        fixed,
        [*scalars(vectors), *scalars([e.phi for e in moving]), *constants],
        [
            *[interval for box in ranges for interval in box],
            *map(point, values),
        ],
    )


def scalars(vectors: Sequence[ca.SX]) -> list[ca.SX]:
    """All components as scalars, one after another."""
    return [component for v in vectors for component in ca.vertsplit(v)]
