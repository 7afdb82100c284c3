"""Terms of h_tot by automatic differentiation of its composition, where jets do not suffice.

D_k = Σ_l ‖∂ψ_{k-1}/∂x_l‖ φ_l^max within ψ_k needs the gradient of ψ_{k-1}, and so does the rate at
which shares tighten. CasADi differentiates the composition of all pairs: a graph of vectors that
contains h of each kind of pair, and the dynamics of each kind of member, once.

The exp and log of portable.py have no exact derivatives. So h_tot is expanded around its value at
the sample: polynomials with the derivatives of LSE there, up to the order that is needed.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Index
from phalanx.theory.expressions import exponential
from phalanx.theory.expressions.portable import as_written, portable_function
from phalanx.theory.rows.composed_function import Gathered, MembersByKind, Placed, TermsByKind
from phalanx.theory.rows.members import MemberKind, SwarmMembers
from phalanx.theory.safety.chain import ROUNDED
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import FAR
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs

_MOST_KEPT = 64
"""Number of functions to keep, one for each count of pairs and members that are seen."""
_Counts = tuple[tuple[int, int], ...]
"""(number of a kind, count of its pairs or members)."""


class _Sample(NamedTuple):
    """LSE of r pairs at the sample, constants under differentiation."""

    h: ca.MX
    """shape (r,)"""
    exponentials: ca.MX
    """exp(ρ (h - max h)), shape (r,)"""
    total: ca.MX
    """Their sum."""
    value: ca.MX
    """h_tot"""


class _Group(NamedTuple):
    """The members of one kind."""

    kind: MemberKind
    x: ca.MX
    """The states, shape (n, r)."""
    places: ca.MX
    """Places of the states among the numbers, shape (n r,)."""
    phi: ca.MX
    """φ_l^max, shape (1, r)."""


class _Graph(NamedTuple):
    """The chain as CasADi expressions of the numbers."""

    numbers: ca.MX
    gathered: Gathered
    h: ca.MX
    sample: _Sample
    members: list[_Group]
    psi: list[ca.MX]
    unforced: ca.MX
    c: ca.MX
    """L_{g_l} ψ_{q-1}^{x_l} of all members, stacked."""
    disturbance: ca.MX
    """D_q"""


class TermsByDerivatives(TermsByKind):
    """The chain of safety.chain.build_chain, built kind by kind."""

    def __init__(
        self,
        pairs: SwarmPairs,
        members: SwarmMembers,
        rho: float,
        alphas: Sequence[ClassK],
        xi: float | None,
        bounds: Sequence[float],
        printed: bool = False,
    ) -> None:
        """Take pairs and members of the swarm, ρ of LSE, and arguments as build_chain has them.

        printed: leave D_k out of the chain.
        """
        super().__init__(pairs, members)
        self._rho, self._xi, self._printed = rho, xi, printed
        self._phi = len(self.numbers) + np.arange(len(pairs.members))
        self.numbers = np.concatenate([self.numbers, bounds])
        s = ca.SX.sym("s")
        self._alphas = [portable_function([s], ca.SX(alpha.value(s))) for alpha in alphas]
        self._made = lru_cache(_MOST_KEPT)(self._make)
        self._rates = lru_cache(_MOST_KEPT)(self._make_rates)

    def room(self, count: int) -> int:
        return count

    def function(self, members: MembersByKind, pairs: ChosenPairs) -> Placed:
        tables = self._places(members, pairs)
        tables += [self.members.arguments(k, own) for k, own in members]
        return self._made(*_counts(members, pairs)), tables

    def rates(self, members: MembersByKind, pairs: ChosenPairs) -> Placed:
        """The growth of ψ_q while all members hold inputs w, as a function like `function`'s.

        It also takes w, stacked as c is. Its results: ∂ψ_q/∂x f + Σ_l ‖∂ψ_q/∂x_l‖ φ_l^max, and
        ∂ψ_q/∂x_l g_l of all members.
        """
        return self._rates(*_counts(members, pairs)), self._places(members, pairs)

    def _places(self, members: MembersByKind, pairs: ChosenPairs) -> list[Index]:
        tables = [group.places for group in pairs.groups]
        for _, own in members:
            tables += [self.members.places(own), self._phi[list(own)]]
        return tables

    def _make(self, pairs: _Counts, members: _Counts) -> ca.Function:
        graph = self._graph(pairs, members)
        ends = self.extremes(graph.numbers, graph.c, members, graph.gathered)
        results = [*graph.psi, graph.unforced, graph.disturbance, graph.c, *ends]
        return self._at_sample(graph, [], results)

    def _make_rates(self, pairs: _Counts, members: _Counts) -> ca.Function:
        graph = self._graph(pairs, members)
        w = ca.MX.sym("w", graph.c.numel())
        last = graph.unforced + ca.sum1(graph.c * w)
        if self.pairs.degree > 1:
            last += graph.disturbance  # part of ψ_q; for q = 1 it is in η
        slopes = _slopes(last, graph.numbers, graph.members)
        growth = _drift(slopes, graph.members) + _disturbance(slopes, graph.members, 0.0)
        return self._at_sample(graph, [w], [growth, _forces(slopes, graph.members)])

    def _graph(self, pairs: _Counts, members: _Counts) -> _Graph:
        q, numbers, chosen = self.pairs.degree, ca.MX.sym("numbers", len(self.numbers)), Gathered()
        each = []
        for k, count in pairs:
            function = self.pairs.kinds[k].h
            each.append(
                ca.vec(function.differentiable(count)(chosen(numbers, function.inputs, count)))
            )
        h = ca.vertcat(*each, FAR)  # so that h is not empty
        sample = _Sample(*[ca.MX.sym("sample", n) for n in (h.numel(), h.numel(), 1, 1)])
        groups = []
        for k, count in members:
            kind = self.members.kinds[k]
            x = chosen(numbers, kind.x.numel(), count)
            groups.append(_Group(kind, x, chosen.places[-1], chosen(numbers, 1, count)))
        psi = [_h_tot(h, sample, self._rho, q + 1)]
        for degree, alpha in enumerate(self._alphas, start=1):
            slopes = _slopes(psi[-1], numbers, groups)
            unforced = _drift(slopes, groups) + alpha(psi[-1])
            disturbance = ca.MX(0.0) if self._printed else _disturbance(slopes, groups, ROUNDED)
            if degree < q:
                xi = disturbance if degree > 1 or self._xi is None else self._xi
                psi.append(unforced + xi)
        forces = _forces(slopes, groups)
        return _Graph(numbers, chosen, h, sample, groups, psi, unforced, forces, disturbance)

    def _at_sample(self, graph: _Graph, more: list[ca.MX], results: Sequence[ca.MX]) -> ca.Function:
        """The function of numbers, places and more, with the sample's values substituted."""
        given = [graph.numbers, *graph.gathered.places, *more]
        around = ca.Function("around", [*given, *graph.sample], [ca.vertcat(*results)])
        sigma = ca.mmax(graph.h)
        with as_written():
            exponentials = exponential.exp(self._rho * (graph.h - sigma))
            total = ca.sum1(exponentials)
            value = sigma + exponential.log(total) / self._rho
        found = around.call([*given, graph.h, exponentials, total, value], True, False)
        return ca.Function("terms", given, found)


def _counts(members: MembersByKind, pairs: ChosenPairs) -> tuple[_Counts, _Counts]:
    return (
        tuple((group.number, len(group.pairs)) for group in pairs.groups),
        tuple((k, len(own)) for k, own in members),
    )


def _h_tot(h: ca.MX, sample: _Sample, rho: float, order: int) -> ca.MX:
    """LSE around the sample, with its derivatives up to `order`."""
    z, series = rho * (h - sample.h), ca.MX(1.0)
    for k in range(order, 0, -1):
        series = 1.0 + z / k * series
    rise = (ca.sum1(sample.exponentials * series) - sample.total) / sample.total
    logarithm = ca.MX(0.0)
    for k in range(order, 0, -1):
        logarithm = 1.0 / k - rise * logarithm
    return sample.value + rise * logarithm / rho


def _slopes(value: ca.MX, numbers: ca.MX, members: Sequence[_Group]) -> list[ca.MX]:
    """∂value/∂x_l of each kind's members, shapes (n, r)."""
    gradient = ca.gradient(value, numbers)
    return [ca.reshape(gradient[own.places], *own.x.shape) for own in members]


def _drift(slopes: Sequence[ca.MX], members: Sequence[_Group]) -> ca.MX:
    """Σ_l slope_l f_l, scalar."""
    total = ca.MX(0.0)
    for slope, own in zip(slopes, members, strict=True):
        total += ca.sum1(ca.sum2(slope * own.kind.drift.differentiable(own.x.shape[1])(own.x)))
    return total


def _forces(slopes: Sequence[ca.MX], members: Sequence[_Group]) -> ca.MX:
    """slope_l g_l of all members, stacked."""
    each = [
        ca.vec(own.kind.forces.differentiable(own.x.shape[1])(ca.vertcat(own.x, slope)))
        for slope, own in zip(slopes, members, strict=True)
    ]
    return ca.vertcat(*each)


def _disturbance(slopes: Sequence[ca.MX], members: Sequence[_Group], rounded: float) -> ca.MX:
    """Σ_l ‖slope_l‖ φ_l^max, scalar; rounded: as in chain.disturbance_bound."""
    total = ca.MX(0.0)
    for slope, own in zip(slopes, members, strict=True):
        norms = ca.sqrt(ca.sum1(slope * slope) + rounded * rounded)
        total += ca.sum2(own.phi * norms)
    return total
