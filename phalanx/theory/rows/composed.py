"""Terms of h_tot at a sampled state, composed from the pairs that an agent sees.

Nothing in it grows with the swarm: pairs are evaluated kind by kind, and only among the seen.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.exact import added
from phalanx.theory.margins.margin import ComposedMargin
from phalanx.theory.rows.members import ChosenMembers, SwarmMembers
from phalanx.theory.rows.near import ObstaclesInSight
from phalanx.theory.rows.terms import Terms
from phalanx.theory.safety.chain import rounded_norm
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs

Array = NDArray[np.float64]


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


class _Selection(NamedTuple):
    """Who and what is composed, as long as that stays the same."""

    key: tuple[tuple[int, ...], bytes]
    pairs: ChosenPairs
    members: ChosenMembers


class ComposedTerms:
    """One agent's terms of h_tot at any state."""

    def __init__(
        self, swarm: SwarmTerms, i: int, radius: float | None, margin: ComposedMargin
    ) -> None:
        self._swarm, self._margin = swarm, margin
        self._own = swarm.members.states[i]
        self._near = swarm.in_sight.of(swarm.dynamics[i], radius)
        self._numbers = swarm.numbers.copy()
        self._selected: _Selection | None = None

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> Terms:
        """Evaluate at a stacked state, shape (n̄,), of which only the members seen are known.

        Args:
            x: anything where it is not known.
            seen: in ascending order; None for all.
        """
        swarm, numbers = self._swarm, self._numbers
        seen = swarm.everybody if seen is None else tuple(seen)
        selected = self._select(x, seen)
        pairs, inputs = selected.pairs, swarm.members.inputs
        numbers[: len(x)] = x
        h, forces = pairs.jets_at(numbers)
        psi, unforced, weights = swarm.jets(h)
        pushes = weights[:, -1].take(pairs.force_pair)
        pushes *= forces
        # It adds up in the order of the pairs.
        c = np.bincount(pairs.force_input, pushes, inputs[-1].stop).astype(np.float64, copy=False)
        numbers[swarm.members.c] = c
        positions, least, most, polytopes = selected.members(numbers)
        margin = self._margin
        push = self._push(x, weights, selected) if margin.bounds else 0.0
        return Terms(
            psi=psi,
            unforced=unforced,
            c={l: c[inputs[l]] for l in seen},
            least=least,
            most=most,
            polytopes=polytopes,
            positions=positions,
            margin=margin.scale * (margin.eta + push),
        )

    def psi(self, x: Array, seen: Sequence[int] | None = None) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,)."""
        selected = self._select(x, self._swarm.everybody if seen is None else tuple(seen))
        return self._swarm.jets(selected.pairs.jets(x).h).psi

    def _select(self, x: Array, seen: tuple[int, ...]) -> _Selection:
        near = self._near(x[self._own])[0] if self._near else None
        key = seen, b"" if near is None else near.tobytes()
        if self._selected is None or self._selected.key != key:
            around = None if near is None else np.flatnonzero(near).tolist()
            pairs = self._swarm.pairs
            chosen = pairs.choose(pairs.among(seen, around))
            self._selected = _Selection(key, chosen, self._swarm.members.choose(seen))
        return self._selected

    def _push(self, x: Array, weights: Array, selected: _Selection) -> float:
        """D: how fast the disturbances can push ψ_{q-1} up."""
        slopes = pushed_slopes(selected.pairs, weights, x)
        states, bounds = self._swarm.members.states, self._margin.bounds
        return added(rounded_norm(slopes[states[l]]) * bounds[l] for l in selected.key[0])


def pushed_slopes(pairs: ChosenPairs, weights: Array, x: Array) -> Array:
    """∂ψ_{q-1}/∂x at the stacked state x, shape (n̄,): zero for who is in no pair.

    weights: of these pairs, as LogSumExpJets has them.
    """
    each = (weights.T[:, pairs.slope_pair] * pairs.slopes(x)).sum(axis=0)
    return np.bincount(pairs.slope_state, each, len(x)).astype(np.float64, copy=False)
