"""Terms of h_tot at a sampled state, composed from the pairs that an agent sees.

Nothing in it grows with the swarm: pairs are evaluated kind by kind, and only among the seen.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import added
from phalanx.theory.margins.margin import ComposedMargin
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.members import ChosenMembers, InputExtremes, SwarmMembers
from phalanx.theory.rows.near import ObstaclesInSight
from phalanx.theory.safety.chain import rounded_norm
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs

_NONE = ComposedMargin(0.0)


class SwarmTerms:
    """What the terms of every agent of a swarm are made of; built once for all."""

    def __init__(
        self,
        pairs: SwarmPairs,
        rho: float,
        alphas: Sequence[ClassK],
        xi: float,
    ) -> None:
        """alphas: α_1 ... α_q. xi: of Eq. (xi).

        Raises EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        self.pairs = pairs
        self.members = SwarmMembers(pairs.members, len(pairs.parameters))
        states, inputs = self.members.states[-1].stop, self.members.inputs[-1].stop
        self.numbers = np.concatenate(
            [np.zeros(states), self.pairs.parameters, np.zeros(inputs), self.members.corners]
        )
        """What one evaluation takes: the state, obstacles, c of all members and corners of U."""
        self.jets = LogSumExpJets(rho, alphas, xi)
        self.everybody = tuple(range(len(pairs.members)))
        self.dynamics = [m.dynamics for m in pairs.members]
        self.in_sight = ObstaclesInSight(pairs.obstacles)

    def of(self, i: int, radius: float | None, margin: ComposedMargin = _NONE) -> "ComposedTerms":
        """Agent i's terms. radius: how far it sees obstacles [m]; None for all."""
        return ComposedTerms(self, i, radius, margin)


class _Chosen(NamedTuple):
    """Who and what is composed, as long as that stays the same."""

    key: tuple[tuple[int, ...], bytes]
    pairs: ChosenPairs


class _Composed(NamedTuple):
    """The terms that pairs are composed for, as Terms has them."""

    psi: Array
    unforced: float
    c: Mapping[int, Array]
    extremes: InputExtremes
    margin: float


class ComposedTerms:
    """One agent's terms of h_tot at any state."""

    def __init__(
        self, swarm: SwarmTerms, i: int, radius: float | None, margin: ComposedMargin
    ) -> None:
        self._swarm, self._margin = swarm, margin
        self._own = swarm.members.states[i]
        self._near = swarm.in_sight.of(swarm.dynamics[i], radius)
        self._chosen: _Chosen | None = None
        self._seen: tuple[int, ...] = ()
        self._members = swarm.members.choose(())

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> "SeenTerms":
        """At a stacked state, shape (n̄,), of which only the members seen are known.

        Args:
            x: anything where it is not known. It is read when a term is asked for.
            seen: in ascending order; None for all.
        """
        return SeenTerms(self, x, self._swarm.everybody if seen is None else tuple(seen))

    @property
    def known(self) -> Mapping[int, Polytope] | None:
        """U_l of everybody, unless some vary with the state."""
        members = self._swarm.members
        return members.known if len(members.known) == len(members.kinds) else None

    def positions(self, x: Array, seen: tuple[int, ...]) -> Mapping[int, Array]:
        """Output positions [m] of those seen at x."""
        return self._choose_members(seen).positions(x)

    def composed(self, x: Array, seen: tuple[int, ...]) -> _Composed:
        """What all pairs in sight come to at x."""
        swarm, pairs = self._swarm, self._choose_pairs(x, seen)
        inputs, numbers = swarm.members.inputs, self._numbers
        numbers[: len(x)] = x
        h, forces = pairs.jets_at(numbers)
        psi, unforced, weights = swarm.jets(h)
        pushes = weights[:, -1].take(pairs.force_pair)
        pushes *= forces
        # It adds up in the order of the pairs.
        c = np.bincount(pairs.force_input, pushes, inputs[-1].stop).astype(np.float64, copy=False)
        numbers[swarm.members.c] = c
        extremes = self._choose_members(seen).extremes(numbers)
        margin = self._margin
        push = self._push(x, weights, pairs, seen) if margin.bounds else 0.0
        each = {l: c[inputs[l]] for l in seen}
        return _Composed(psi, unforced, each, extremes, margin.scale * (margin.eta + push))

    def psi(self, x: Array, seen: Sequence[int] | None = None) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,)."""
        pairs = self._choose_pairs(x, self._swarm.everybody if seen is None else tuple(seen))
        return self._swarm.jets(pairs.jets(x).h).psi

    @cached_property
    def _numbers(self) -> Array:
        return self._swarm.numbers.copy()

    def _choose_members(self, seen: tuple[int, ...]) -> ChosenMembers:
        if seen != self._seen:
            self._seen, self._members = seen, self._swarm.members.choose(seen)
        return self._members

    def _choose_pairs(self, x: Array, seen: tuple[int, ...]) -> ChosenPairs:
        near = self._near(x[self._own])[0] if self._near else None
        key = seen, b"" if near is None else near.tobytes()
        if self._chosen is None or self._chosen.key != key:
            around = None if near is None else np.flatnonzero(near).tolist()
            pairs = self._swarm.pairs
            self._chosen = _Chosen(key, pairs.choose(pairs.among(seen, around)))
        return self._chosen.pairs

    def _push(self, x: Array, weights: Array, pairs: ChosenPairs, seen: tuple[int, ...]) -> float:
        """D: how fast the disturbances can push ψ_{q-1} up."""
        slopes = pushed_slopes(pairs, weights, x)
        states, bounds = self._swarm.members.states, self._margin.bounds
        return added(rounded_norm(slopes[states[l]]) * bounds[l] for l in seen)


class SeenTerms:
    """One agent's terms at one state, composed when asked for: who keeps rows of pairs may not."""

    def __init__(self, terms: ComposedTerms, x: Array, seen: tuple[int, ...]) -> None:
        self._terms, self._x, self._seen = terms, x, seen

    @cached_property
    def positions(self) -> Mapping[int, Array]:
        """As Terms has them, like all that follow."""
        return self._terms.positions(self._x, self._seen)

    @property
    def polytopes(self) -> Mapping[int, Polytope]:
        known = self._terms.known
        return self._composed.extremes.polytopes if known is None else known

    @property
    def psi(self) -> Array:
        return self._composed.psi

    @property
    def unforced(self) -> float:
        return self._composed.unforced

    @property
    def c(self) -> Mapping[int, Array]:
        return self._composed.c

    @property
    def least(self) -> Mapping[int, float]:
        return self._composed.extremes.least

    @property
    def most(self) -> Mapping[int, float]:
        return self._composed.extremes.most

    @property
    def margin(self) -> float:
        return self._composed.margin

    @cached_property
    def _composed(self) -> _Composed:
        return self._terms.composed(self._x, self._seen)


def pushed_slopes(pairs: ChosenPairs, weights: Array, x: Array) -> Array:
    """∂ψ_{q-1}/∂x at the stacked state x, shape (n̄,): zero for who is in no pair.

    weights: of these pairs, as LogSumExpJets has them.
    """
    each = (weights.T[:, pairs.slope_pair] * pairs.slopes(x)).sum(axis=0)
    return np.bincount(pairs.slope_state, each, len(x)).astype(np.float64, copy=False)
