"""The chain ψ_0^d, ..., ψ_q^d of Eq. (psifuncs), its relative degree q and its Lie derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from phalanx.theory.safety.class_k import ClassK, Linear
from phalanx.theory.safety.composition import ComposedSet, Member

ROUNDED = 1e-4
"""δ in sqrt(‖·‖² + δ²), a smooth upper bound of a norm."""


class RelativeDegreeError(ValueError):
    """Assumption (relativedeg) fails: the inputs do not all appear at one relative degree."""


@dataclass(frozen=True)
class Chain:
    """ψ_0^d ... ψ_{q-1}^d and the parts of ψ_q^d, as expressions of the stacked state.

    >>> from phalanx.theory.safety.chain import build_chain
    >>> from phalanx.theory.safety.composition import of_pair
    >>> a, b = (Member(name, SingleIntegrator(speed=1.0), False) for name in "ab")
    >>> build_chain(of_pair(a, b, Separation(radius=1.0)), [1.0]).relative_degree
    1
    """

    set: ComposedSet
    psi: tuple[ca.SX, ...]
    """ψ_0^d = h_tot to ψ_{q-1}^d, scalars; q = len(psi)."""
    drift: ca.SX
    """L_{f_l} ψ_{q-1}^{x_l} of each member l, shape (N,)."""
    actuation: tuple[ca.SX, ...]
    """L_{g_l} ψ_{q-1}^{x_l} of each member l, shapes (1, m_l)."""
    alpha: ca.SX
    """α_q(ψ_{q-1}^d), scalar."""
    disturbance: ca.SX
    """D_q = Σ_l ‖∂ψ_{q-1}/∂x_l‖ φ_l^max, scalar; 0 where the chain was built without bounds."""

    @property
    def relative_degree(self) -> int:
        """q."""
        return len(self.psi)


def build_chain(
    composed: ComposedSet,
    alphas: Sequence[float | ClassK],
    xi: float | None = 0.0,
    bounds: Sequence[float] | None = None,
) -> Chain:
    """Differentiate h_tot along the drift until the inputs appear.

    Eq. (psifuncs) as printed bounds the disturbance in ψ_1 only, yet each ψ̇_k contains L_φ ψ_k.
    With `bounds` every ψ_{k+1} from ψ_2 on has D_{k+1} = Σ_l ‖∂ψ_k/∂x_l‖ φ_l^max too.

    Args:
        composed: the safe set.
        alphas: α_1, ..., α_q, one for each degree; a number is the gain of a linear one [1/s].
        xi: the constant ξ of Eq. (xi), which bounds L_φ h in ψ_1^d; unused when q = 1. None for
            the state-dependent D_1 in its place; needs bounds.
        bounds: φ_l^max of each member, or None for the chain as printed.

    Raises:
        RelativeDegreeError: the members' inputs appear at different degrees, or the number of
            alphas is not q.
    """
    psi = composed.h_tot
    chain = [psi]
    for degree, entry in enumerate(alphas, start=1):
        alpha = entry if isinstance(entry, ClassK) else Linear(entry)
        gradients, drifts, actuations = lie_derivatives(composed, psi)
        appeared = [a.nnz() > 0 for a in actuations]
        if inputs_appear(composed.members, appeared, degree, len(alphas)):
            last = disturbance_bound(gradients, bounds, ROUNDED)
            drift, alpha_q = ca.vertcat(*drifts), alpha.value(psi)
            return Chain(composed, tuple(chain), drift, actuations, alpha_q, last)
        disturbance = disturbance_bound(gradients, bounds, ROUNDED)
        if degree == 1 and xi is not None:
            disturbance = ca.SX(xi)
        psi = ca.sum1(ca.vertcat(*drifts)) + disturbance + alpha.value(psi)
        chain.append(psi)
    raise degree_above(len(alphas))


class LieDerivatives(NamedTuple):
    """Derivatives of one scalar V along the dynamics of each member l."""

    gradients: tuple[ca.SX, ...]
    """∂V/∂x_l, shapes (1, n_l)."""
    drifts: tuple[ca.SX, ...]
    """L_{f_l} V, scalars."""
    actuations: tuple[ca.SX, ...]
    """L_{g_l} V, shapes (1, m_l)."""


def lie_derivatives(composed: ComposedSet, value: ca.SX) -> LieDerivatives:
    """Differentiate an expression of the members' states."""
    derivatives = []
    for member, part in zip(composed.members, composed.parts, strict=True):
        x, dynamics = composed.x[part], member.dynamics
        gradient = ca.jacobian(value, x)
        actuation = ca.sparsify(ca.simplify(gradient @ dynamics.actuation(x)))
        derivatives.append((gradient, gradient @ dynamics.drift(x), actuation))
    return LieDerivatives(*zip(*derivatives, strict=True))


def disturbance_bound(
    gradients: Sequence[ca.SX], bounds: Sequence[float] | None, rounded: float = 0.0
) -> ca.SX:
    """D = Σ_l ‖gradient_l‖ φ_l^max, scalar; 0 without bounds.

    rounded: δ as in ROUNDED, so that the sum can be differentiated where a gradient is zero.
    """
    total = ca.SX(0)
    for gradient, bound in zip(gradients, bounds or (), strict=bounds is not None):
        total += bound * ca.sqrt(ca.sumsqr(gradient) + rounded * rounded)
    return total


def inputs_appear(
    members: Sequence[Member], appeared: Sequence[bool], degree: int, gains: int
) -> bool:
    """Return whether the inputs appear in ψ_degree, so that the degree is q.

    Args:
        members: all of the swarm.
        appeared: whether each member's inputs appear, shape (N,).
        degree: k of ψ_k.
        gains: number of α_k.

    Raises:
        RelativeDegreeError: some appear and others do not, or there is not one α_k for each degree.
    """
    if not any(appeared):
        return False
    names = [
        [m.name for m, a in zip(members, appeared, strict=True) if a is side]
        for side in (True, False)
    ]
    if names[1]:
        raise RelativeDegreeError(
            f"Assumption (relativedeg): the inputs of {', '.join(names[0])} appear in ψ_{degree}, "
            f"those of {', '.join(names[1])} only later; all agents need one relative degree"
        )
    if gains != degree:
        raise RelativeDegreeError(
            f"safety.alpha: the relative degree q is {degree}, so expected {degree} "
            f"gains α_1 ... α_q, got {gains}"
        )
    return True


def degree_above(gains: int) -> RelativeDegreeError:
    """The error for a chain in which no input appears up to ψ_gains."""
    return RelativeDegreeError(
        f"safety.alpha: no input appears in ψ_{gains}; the relative degree q is above "
        f"{gains}: give one for each of α_1 ... α_q"
    )
