"""A margin that is a bound: how far a row can drift before its agent samples again.

For a sampled state x^k the states that the swarm can reach within τ lie in a box: every input
anywhere in its U_l, every disturbance within its bound (a Picard enclosure). Over that box
interval arithmetic bounds the rate of everything in the row, and L_φ ψ_{q-1}. Unlike
Eq. (mainetadef) it needs no compact S, no Lipschitz constants and no workspace: the bound is
computed anew at each sample.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.theory.expressions.interval import (
    Interval,
    add,
    continuous,
    extend,
    hull,
    inflate,
    inside,
    multiply,
    point,
)
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.composition import Member

UNKNOWN = 1e12
"""The margin where no enclosure was found: no row holds with it."""

ACTUATION = 1e-5
"""How far an applied input may stand outside U_l or its row: solvers are not exact."""

_LEAST = 1e-9


def local_margin(
    chain: Chain,
    i: int,
    horizon: float | ca.SX,
    bounds: Sequence[float],
    part: RowPart,
    active: ca.SX | None = None,
) -> ca.SX:
    """Bound on the growth of agent i's row, scalar, an expression of the sampled state.

    Args:
        chain: of one pair or of a composed set, its D_q included.
        i: the member whose row it is.
        horizon: τ = Γ_i + δ_i^max and the latency [s].
        bounds: φ_l^max of each member.
        part: which row, as RowPart writes them out.
        active: which pairs count, as ComposedSet.substitute has it.

    Raises:
        ValueError: a member's U_l depends on the state.
        UnboundedOperationError: an expression has no interval extension.
    """
    members, x = chain.set.members, chain.set.x
    motion = [ca.SX.sym(f"u_{m.name}", len(m.dynamics.inputs)) for m in members]
    fixed = [ca.SX.sym(f"w_{m.name}", len(m.dynamics.inputs)) for m in members]
    fixed[i] = motion[i]
    inputs = [_input_box(m) for m in members]
    phi = [Interval(ca.SX(-b), ca.SX(b)) for b in bounds]

    share = part.value
    row = chain.actuation[i] @ fixed[i] + share * (ca.sum1(chain.drift) + chain.alpha)
    if part is RowPart.WHOLE:
        for l, c in enumerate(chain.actuation):
            row += 0 if l == i else c @ fixed[l]
    slope = ca.jacobian(row, x)
    disturbances = [ca.SX.sym(f"phi_{m.name}", len(m.dynamics.states)) for m in members]
    rates = ca.vertcat(
        *[
            m.dynamics.drift(x[own]) + m.dynamics.actuation(x[own]) @ u + d
            for m, own, u, d in zip(members, chain.set.parts, motion, disturbances, strict=True)
        ]
    )
    pushed = [phi[l] for l, m in enumerate(members) for _ in m.dynamics.states]
    box, enclosed = _enclosure(x, rates, motion, disturbances, inputs, pushed, horizon)

    others = [fixed[l] for l in range(len(members)) if l != i]
    other_boxes = [inputs[l] for l in range(len(members)) if l != i]
    # σ and the active pairs are those of the sample, whatever x does afterwards.
    kept = [chain.set.sigma, chain.set.active]
    at_sample = [point(chain.set.substitute(s, active)) for s in _scalars(kept)]
    symbols = _scalars([x, *motion, *others, *disturbances, *kept])
    intervals = [*box, *_flat(inputs), *_flat(other_boxes), *pushed, *at_sample]
    growth, disturbance = extend([slope @ rates, share * chain.disturbance], symbols, intervals)
    forces = [chain.set.substitute(c, active) for c in chain.actuation]
    outside = ACTUATION * ca.sum1(ca.vertcat(*[ca.norm_1(c.T) for c in forces]))
    bound = horizon * ca.fmax(0, growth.hi) + disturbance.hi + outside
    # Comparisons are false for what is not a number, which max would pass over.
    known = ca.logic_and(growth.hi < UNKNOWN, disturbance.hi < UNKNOWN)
    # Where the row can jump, its rate does not bound it: h must be C^{1,1}, as in the paper. What
    # α adds is continuous.
    parts = [*map(ca.vec, chain.actuation), chain.drift]
    smooth = continuous(_scalars(parts), symbols, intervals)
    return ca.if_else(ca.logic_and(ca.logic_and(enclosed, known), smooth), bound, UNKNOWN)


def _enclosure(
    x: ca.SX,
    rates: ca.SX,
    motion: Sequence[ca.SX],
    disturbances: Sequence[ca.SX],
    inputs: Sequence[Sequence[Interval]],
    pushed: Sequence[Interval],
    horizon: float | ca.SX,
) -> tuple[list[Interval], ca.SX]:
    """A box that holds x(t) for all t up to the horizon, and whether that is certain.

    If x^k + [0, τ] F(B) lies in B, where F bounds x' over B, then x(t) cannot leave B by τ.
    """
    symbols = _scalars([x, *motion, *disturbances])
    span = Interval(ca.SX(0), ca.SX(horizon))

    def moved(box: Sequence[Interval]) -> list[Interval]:
        bounds = extend(ca.vertsplit(rates), symbols, [*box, *_flat(inputs), *pushed])
        return [
            add(start, multiply(span, rate)) for start, rate in zip(starts, bounds, strict=True)
        ]

    starts = [point(component) for component in ca.vertsplit(x)]
    box = starts
    for extra in (0.2, 0.1):
        reached = [hull(a, b) for a, b in zip(starts, moved(box), strict=True)]
        box = [inflate(reach, extra, _LEAST) for reach in reached]
    final = moved(box)
    certain = ca.SX(1)
    for a, b in zip(final, box, strict=True):
        certain = ca.logic_and(certain, inside(a, b))
    return final, certain


def _input_box(member: Member) -> list[Interval]:
    x = ca.SX.sym("x", len(member.dynamics.states))
    known = constant_polytope(*member.dynamics.input_polytope(x))
    if known is None:
        raise ValueError(
            f"safety.margin: expected input bounds of {member.name} that do not depend on its "
            "state, which the local margin needs"
        )
    low, high = known.corners.min(axis=0), known.corners.max(axis=0)
    ends = np.stack([low - ACTUATION, high + ACTUATION], axis=1)
    return [Interval(ca.SX(a), ca.SX(b)) for a, b in ends.tolist()]


def _scalars(vectors: Sequence[ca.SX]) -> list[ca.SX]:
    return [component for v in vectors for component in ca.vertsplit(v)]


def _flat(boxes: Sequence[Sequence[Interval]]) -> list[Interval]:
    return [interval for box in boxes for interval in box]
