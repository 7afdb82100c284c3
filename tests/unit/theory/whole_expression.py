"""Terms of a chain as one expression of all states: what terms from kinds are compared with."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import casadi as ca

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.polytope import Polytope, constant_polytope, extremes, polytope
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.composition import FAR, ComposedSet


@dataclass(frozen=True)
class SetInSight(ComposedSet):
    """The safe set of what agent i sees: pairs of which both sides are within its radius [m]."""

    i: int = 0
    radius: float = 0.0

    @cached_property
    def near(self) -> ca.SX:
        """1 for a pair in sight, else 0, shape (p,)."""
        p = self.positions
        near = [ca.norm_2(q - p[self.i]) <= self.radius if q is not p[self.i] else 1 for q in p]
        near += [o.distance(p[self.i]) <= self.radius for o in self.obstacles]
        return ca.vertcat(*[near[a] * near[b] for a, b in self.pairs])

    @cached_property
    def h(self) -> ca.SX:
        """h of pairs in sight; FAR, which has no gradient, for the others."""
        return self.near * super().h + (1 - self.near) * FAR


def in_sight(composed: ComposedSet, i: int, radius: float | None) -> ComposedSet:
    """Return the set that agent i sees; all for no radius."""
    if radius is None:
        return composed
    values = {f.name: getattr(composed, f.name) for f in fields(composed)}
    return SetInSight(**values, i=i, radius=radius)


class EvaluatedTerms(NamedTuple):
    """Terms that are numbers already."""

    psi: Array
    unforced: float
    c: Mapping[int, Array]
    least: Mapping[int, float]
    most: Mapping[int, float]
    polytopes: Mapping[int, Polytope]
    positions: Mapping[int, Array]
    margin: float


class TermsFunction:
    """Compiles a chain once; evaluates it at any sampled state in a few microseconds.

    Where U_l is constant its vertices are known beforehand, and the linear programs of
    Eq. (LPvminmax) become part of the compiled expression.
    """

    def __init__(self, chain: Chain, margin: ca.SX | float = 0.0) -> None:
        """Compile.

        Args:
            chain: of the composed set.
            margin: of the row that the terms are for, scalar.

        Raises:
            EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        composed = chain.set
        symbolic = [
            member.dynamics.input_polytope(composed.x[part])
            for member, part in zip(composed.members, composed.parts, strict=True)
        ]
        constant = [constant_polytope(A, b) for A, b in symbolic]
        self._varying = [l for l, fixed in enumerate(constant) if fixed is None]
        self._polytopes = {l: fixed for l, fixed in enumerate(constant) if fixed is not None}
        values = [
            ca.DM(fixed.corners) @ row.T if fixed else ca.SX.zeros(1)
            for fixed, row in zip(constant, chain.actuation, strict=True)
        ]
        outputs = [
            ca.vertcat(*chain.psi),
            ca.vertcat(ca.sum1(chain.drift) + chain.alpha, margin),
            ca.vertcat(*[ca.mmin(v) for v in values]),
            ca.vertcat(*[ca.mmax(v) for v in values]),
            *chain.actuation,
            *composed.positions,
            *[expression for l in self._varying for expression in symbolic[l]],
        ]
        settled = [composed.substitute(o) for o in outputs]
        self._evaluate = CompiledFunction([composed.x], settled)

    def __call__(self, x: Array) -> EvaluatedTerms:
        """Evaluate at a stacked state x, shape (n̄,)."""
        psi, (unforced, margin), least, most, *rest = self._evaluate(x)
        n = len(least)
        c, positions, varying = rest[:n], rest[n : 2 * n], rest[2 * n :]
        polytopes = dict(self._polytopes)
        for l, A, b in zip(self._varying, varying[::2], varying[1::2], strict=True):
            polytopes[l] = polytope(A.reshape(len(b), -1), b)
            least[l], most[l] = extremes(c[l], polytopes[l].corners)
        return EvaluatedTerms(
            psi=psi,
            unforced=float(unforced),
            c=dict(enumerate(c)),
            least=dict(enumerate(least.tolist())),
            most=dict(enumerate(most.tolist())),
            polytopes=polytopes,
            positions=dict(enumerate(positions)),
            margin=float(margin),
        )
