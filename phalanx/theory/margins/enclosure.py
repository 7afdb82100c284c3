"""Where one agent's state can be within a horizon: a Picard enclosure in interval arithmetic."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.extension import extend
from phalanx.theory.expressions.interval import (
    Interval,
    add,
    finite,
    hull,
    inflate,
    inside,
    multiply,
    point,
)
from phalanx.theory.expressions.rounding import rounds_outwards
from phalanx.theory.models.polytope import constant_polytope, vertices
from phalanx.theory.safety.composition import Member

Array = NDArray[np.float64]

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

    def rates(box: Sequence[Interval]) -> list[Interval]:
        return extend(ca.vertsplit(rate), symbols, [*box, *allowed, *pushed])

    box = starts
    for extra in inflations:
        ends = moved(x, rates(box), horizon)
        reached = [hull(a, b) for a, b in zip(starts, ends, strict=True)]
        box = [inflate(reach, extra, _LEAST) for reach in reached]
    last = rates(box)
    final = moved(x, last, horizon)
    certain = finite(last)
    for start, a, b in zip(starts, final, box, strict=True):
        within = ca.logic_and(b.lo < start.lo, start.hi < b.hi)  # not so where 1e-9 is rounded off
        certain = ca.logic_and(certain, ca.logic_and(within, inside(a, b)))
    return Enclosure(x, u, phi, rate, final, allowed, pushed, certain)


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
