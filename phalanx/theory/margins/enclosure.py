"""Where one agent's state can be within a horizon: a Picard enclosure in interval arithmetic."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import (
    Interval,
    add,
    common,
    exponential,
    finite,
    hull,
    inflate,
    inside,
    multiply,
    point,
    reciprocal,
)
from phalanx.theory.expressions.rounding import rounds_outwards
from phalanx.theory.models.polytope import constant_polytope, vertices
from phalanx.theory.safety.composition import Member

_LEAST = 1e-9


class Enclosure(NamedTuple):
    """One member's motion within the horizon: symbols, and the intervals that hold them."""

    x: ca.SX
    """The state, shape (n,)."""
    u: ca.SX
    """The input in force, shape (m,)."""
    phi: ca.SX
    """The disturbance, shape (n,)."""
    rate: ca.SX
    """x' = f + g u + φ, shape (n,)."""
    states: list[Interval]
    """Of every state from the sample to the horizon: the box B."""
    inputs: list[Interval]
    disturbances: list[Interval]
    certain: ca.SX
    """1 if x(t) is proven to stay in `states` until the horizon, else 0."""


def enclose(
    member: Member,
    x: ca.SX,
    inputs: Sequence[Interval] | None,
    bound: float,
    horizon: float | ca.SX,
    inflations: Sequence[float],
) -> Enclosure:
    """A box that holds x(t) for all t up to the horizon, and whether that is certain.

    If x^k + [0, τ] F(B) lies in B, where F bounds x' over B, and x^k inside B, then x(t) cannot
    leave B by τ: as it did, it would be on the way from a point inside to one in B, so inside.
    Where drag slows a component, a bound that takes it into account is closer.

    Args:
        member: whose motion it is; nobody else's state is part of its dynamics.
        x: its sampled state, symbols, shape (n,).
        inputs: what each of its inputs may be, at any time; None if it holds the one input u, on
            whose symbols the intervals then depend.
        bound: φ^max.
        horizon: τ [s].
        inflations: by which share the box is made wider, round by round; more rounds reach a
            longer horizon.

    Raises:
        UnboundedOperationError: its dynamics have no interval extension.
    """
    u = ca.SX.sym(f"u_{member.name}", len(member.dynamics.inputs))
    phi = ca.SX.sym(f"phi_{member.name}", len(member.dynamics.states))
    rate = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u + phi
    pushed = [Interval(ca.SX(-bound), ca.SX(bound)) for _ in member.dynamics.states]
    allowed = [point(c) for c in ca.vertsplit(u)] if inputs is None else list(inputs)
    symbols = scalars([x, u, phi])
    starts = [point(component) for component in ca.vertsplit(x)]

    # Rows keep the box that their trajectories were made with.
    own = ca.diag(ca.jacobian(rate, x)) if rounds_outwards() else ca.SX.zeros(x.numel())
    slowed = [k for k in range(x.numel()) if not own[k].is_zero()]

    # One round as a function: CasADi writes out the others faster than Python does.
    ends = [Interval(*ca.vertsplit(ca.SX.sym("end", 2))) for _ in starts]
    moving = [*ends, *allowed, *pushed]
    rates = extend(ca.vertsplit(rate), symbols, moving)
    reached = moved(x, rates, horizon)
    for k in slowed:
        reached[k] = common(reached[k], _slowed(k, x, rate, symbols, moving, horizon))
    given = [x, u, ca.vertcat(*ca.symvar(ca.SX(horizon)))]
    one_round = ca.Function("round", [*given, *_sides(ends)], [*_sides(reached), *_sides(rates)])

    def after(box: Sequence[Interval]) -> tuple[list[Interval], list[Interval]]:
        """Where the state can be if it stays in the box, and its rates in there."""
        low, high, least, most = map(ca.vertsplit, one_round.call([*given, *_sides(box)]))
        return list(map(Interval, low, high)), list(map(Interval, least, most))

    box = starts
    for extra in inflations:
        ends, _ = after(box)
        hulls = [hull(a, b) for a, b in zip(starts, ends, strict=True)]
        box = [inflate(each, extra, _LEAST) for each in hulls]
    final, last = after(box)
    certain = finite(last)
    for start, a, b in zip(starts, final, box, strict=True):
        within = ca.logic_and(b.lo < start.lo, start.hi < b.hi)  # not so where 1e-9 is rounded off
        certain = ca.logic_and(certain, ca.logic_and(within, inside(a, b)))
    return Enclosure(x, u, phi, rate, final, allowed, pushed, certain)


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
    """Where x_k can be while the state is in the box, as its own growth slows it; or everywhere.

    If its rate is continuous with ∂rate/∂x_k <= j, it grows by d > 0 at a rate of at most a + j d,
    a the largest over the box but at the start's x_k: d <= a (e^{jτ} - 1) / j, with a > 0, which is
    at most a τ e^{jτ} for j >= 0 and a min(τ, 1/|j|) for j < 0. Downwards likewise. Its own part of
    the box has no hand in a, so that no drag is too strong.

    Args:
        k: which component.
        x: the state at the start, symbols, shape (n,).
        rate: x', shape (n,).
        symbols: what it is of, x first.
        box: of each.
        horizon: τ [s].
    """
    slope, start = ca.jacobian(rate[k], x[k]), point(x[k])
    (steepness,) = extend([slope], symbols, box)
    (begin,) = extend([rate[k]], symbols, [*box[:k], start, *box[k + 1 :]])
    rising = exponential(multiply(point(horizon), point(ca.fmax(0, steepness.hi))))
    falling = ca.if_else(steepness.hi < 0, reciprocal(point(-steepness.hi)).hi, ca.inf)
    time = ca.fmin(multiply(point(horizon), rising).hi, falling)
    found = add(start, hull(point(0.0), multiply(point(time), begin)))
    known = ca.logic_and(steepness.hi < ca.inf, continuous([rate[k]], symbols, box))
    return Interval(ca.if_else(known, found.lo, -ca.inf), ca.if_else(known, found.hi, ca.inf))


def fastest(member: Member, inputs: Sequence[Interval], bound: float) -> list[Interval] | None:
    """What x' can be at any state whatever; None if that has no bounds.

    Args:
        member: whose motion it is.
        inputs: what each of its inputs may be.
        bound: φ^max.

    Raises:
        UnboundedOperationError: its dynamics have no interval extension.
    """
    x = ca.SX.sym("x", len(member.dynamics.states))
    u = ca.SX.sym("u", len(member.dynamics.inputs))
    rate = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u
    anywhere = [Interval(ca.SX(-ca.inf), ca.SX(ca.inf))] * x.numel()
    found = extend(ca.vertsplit(rate), scalars([x, u]), [*anywhere, *inputs])
    pushed = Interval(ca.SX(-bound), ca.SX(bound))
    rates = [add(each, pushed) for each in found]
    return rates if np.isfinite([float(end) for each in rates for end in each]).all() else None


def moved(x: ca.SX, rates: Sequence[Interval], horizon: float | ca.SX) -> list[Interval]:
    """x + [0, τ] rates, by component; a rate that is no number is passed over."""
    time = point(horizon)
    return [
        add(point(start), hull(point(0.0), multiply(time, rate)))
        for start, rate in zip(ca.vertsplit(x), rates, strict=True)
    ]


def admissible_inputs(member: Member) -> list[Interval]:
    """The box around what an actuator takes for an input in U.

    Raises:
        ValueError: U depends on the state.
    """
    found = admissible_corners(member)
    ends = np.stack([found.min(axis=0), found.max(axis=0)], axis=1)
    return [Interval(ca.SX(a), ca.SX(b)) for a, b in ends.tolist()]


def admissible_corners(member: Member) -> Array:
    """Vertices of what an actuator takes, U with every face moved out, shape (v, m).

    Raises:
        ValueError: U depends on the state.
    """
    x = ca.SX.sym("x", len(member.dynamics.states))
    known = constant_polytope(*member.dynamics.input_polytope(x))
    if known is None:
        raise ValueError(
            f"safety.margin: expected input bounds of {member.name} that do not depend on its "
            "state, which the local margin needs"
        )
    # Vertices are rounded to nearest; a hair more takes them all in.
    share = 1.0 + 1e-6 if rounds_outwards() else 1.0
    return vertices(known.A, known.b + share * known.allowance)


def scalars(vectors: Sequence[ca.SX]) -> list[ca.SX]:
    """All components, one after another."""
    return [component for v in vectors for component in ca.vertsplit(v)]
