"""One row for each pair of an agent, instead of one row for the composed h_tot.

S is the intersection of the pairs' own sets, so that keeping every pair keeps S. A pair with an
adversary or an obstacle is a condition on the normal agent alone. A pair of normal agents is a
joint condition on two: each keeps half of it (split), or assumes an input of the other by its
information model. Constant halves add up at every instant, although the two agents sample at
different ones. As no weights switch, the proven margin is several times smaller than that of LSE.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from msgspec import Struct

from phalanx.theory.arrays import Array, Mask
from phalanx.theory.expressions.compiled import MappedFunction, MappedRows
from phalanx.theory.expressions.exact import inner
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.rows.row import Rows
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.pairs import SwarmPairs, spread


class OwnPair(NamedTuple):
    """One pair of agent i, with its chain."""

    chain: Chain
    """The chain of the pair alone."""
    side: int
    """Agent i's side of the pair: 0 or 1."""

    @property
    def other(self) -> int | None:
        """The other member's side; None for an obstacle."""
        return 1 - self.side if len(self.chain.set.members) == 2 else None


class PairTerms(Struct, frozen=True):
    """Terms at one sampled state, for each pair of agent i in sight; shapes (r,) unless given.

    >>> one, none = np.ones(1), np.zeros(1)
    >>> terms = PairTerms(-np.ones((1, 1)), np.ones((1, 2)), one, none, none, [], (7,), none > 0)
    >>> Rows(terms.a, -(terms.unforced + terms.most)).bound
    array([-1.])
    """

    psi: Array
    """ψ_0 ... ψ_{q-1} of each pair, shape (r, q)."""
    a: Array
    """L_g ψ_{q-1}^{x_i}, shape (r, m_i)."""
    unforced: Array
    """Σ drift + α_q."""
    most: Array
    """max over U_l of c_l u of the other member; 0 for an obstacle."""
    margin: Array
    """Of the row, or of agent i's half, as margins.margin.AgentMargin sums it."""
    forces: list[Array]
    """c_l of the other member, shapes (m_l,); empty for an obstacle."""
    others: tuple[int, ...]
    """The other member's index, or N + k for obstacle k."""
    half: Mask
    """True if agent i keeps half of the pair, False if all of it."""


class PairRowFunction:
    """The row of every pair of one kind, compiled."""

    def __init__(
        self,
        pair: OwnPair,
        part: RowPart,
        margin: ca.SX,
        symbols: Sequence[ca.SX] = (),
    ) -> None:
        """Compile.

        Args:
            pair: one of the kind.
            part: of the pair's condition that the row keeps.
            margin: of that row, an expression of the pair's state and the symbols.
            symbols: further scalars.

        Raises:
            ValueError: the other member's input bounds depend on its state.
        """
        chain, other = pair.chain, pair.other
        self.part = part
        forces = ca.SX(1, 0) if other is None else chain.actuation[other]
        unforced = ca.sum1(chain.drift) + chain.alpha
        a = chain.actuation[pair.side]
        self.sizes = chain.set.sizes
        self.evaluate = MappedFunction(
            [chain.set.x, chain.set.parameters, *symbols],
            [*chain.psi, unforced, most_of_other(pair), margin, a, forces],
        )


class _Group(NamedTuple):
    """Pairs of one kind."""

    others: list[int]
    """The other members, or N + k for obstacle k."""
    part: RowPart
    rows: MappedRows


class _Chosen(NamedTuple):
    """The pairs in sight, kept while they stay the same."""

    key: tuple[object, ...]
    groups: list[_Group]
    results: list[Array]
    """The results of all groups but the forces of the other members, and none if there are none."""
    others: tuple[int, ...]
    """As in PairTerms, like `half`."""
    half: Mask


class OwnPairTerms:
    """Terms of agent i's pairs in sight, at any state."""

    def __init__(
        self,
        swarm: SwarmPairs,
        i: int,
        function: Callable[[int, RowPart], PairRowFunction],
        near: Callable[[Array, Array], Sequence[Array]] | None,
    ) -> None:
        """Prepare for normal agent i of the swarm.

        Args:
            function: (other member, or N + k for obstacle k; part) -> function of the row; the
                same object for all pairs of a kind.
            near: as composed.ObstaclesInSight returns it.
        """
        self._swarm, self._i, self._function, self._near = swarm, i, function, near
        dynamics = swarm.members[i].dynamics
        self._own_state = slice(swarm.begin[i], swarm.begin[i] + len(dynamics.states))
        self._end = swarm.degree + 3 + len(dynamics.inputs)
        """Count of a row's numbers before the forces of the other member."""
        self._chosen: _Chosen | None = None

    def __call__(
        self,
        x: Array,
        in_sight: Sequence[int] | None = None,
        sharing: Sequence[int] = (),
        symbols: Sequence[float] = (),
    ) -> PairTerms:
        """Evaluate at a stacked state, shape (n̄,), of which only members in sight are known.

        Args:
            x: anything for members out of sight.
            in_sight: in ascending order; None for all.
            sharing: normal agents that keep their half; empty unless the model is split.
            symbols: values of those in the margins.
        """
        in_sight = range(len(self._swarm.members)) if in_sight is None else in_sight
        parameters = self._swarm.parameters
        near = self._near(x[self._own_state], parameters)[0] if self._near else None
        key = tuple(in_sight), tuple(sharing), b"" if near is None else near.tobytes()
        if self._chosen is None or self._chosen.key != key:
            self._chosen = self._choose(key, in_sight, near, sharing, len(symbols))
        numbers = np.concatenate([x, parameters, symbols])
        for group in self._chosen.groups:
            group.rows(numbers)
        return self._terms(self._chosen)

    def _choose(
        self,
        key: tuple[object, ...],
        in_sight: Sequence[int],
        near: Array | None,
        sharing: Sequence[int],
        symbols: int,
    ) -> _Chosen:
        swarm, i = self._swarm, self._i
        pairs = swarm.of(i, in_sight, None if near is None else np.flatnonzero(near).tolist())
        functions: dict[PairRowFunction, list[tuple[int, int]]] = {}
        for a, b in pairs.tolist():
            other = b if a == i else a
            part = RowPart.HALF if other in sharing else RowPart.WHOLE
            functions.setdefault(self._function(other, part), []).append((a, b))
        after = swarm.states + len(swarm.parameters) + np.arange(symbols)
        groups = []
        for function, kind_pairs in functions.items():
            indices = spread(swarm.begin, np.array(kind_pairs), function.sizes)
            tail = np.broadcast_to(after, (len(kind_pairs), symbols))
            rows = function.evaluate.at(np.concatenate([indices, tail], axis=1))
            others = [b if a == i else a for a, b in kind_pairs]
            groups.append(_Group(others, function.part, rows))
        entries = [(other, group.part) for group in groups for other in group.others]
        return _Chosen(
            key,
            groups,
            results=[np.zeros((0, self._end)), *[g.rows.results[:, : self._end] for g in groups]],
            others=tuple(other for other, _ in entries),
            half=np.array([part is RowPart.HALF for _, part in entries], dtype=np.bool_),
        )

    def _terms(self, chosen: _Chosen) -> PairTerms:
        """The results of all groups, one after the other."""
        q, end = self._swarm.degree, self._end
        numbers = np.concatenate(chosen.results)
        unforced, most, margin = numbers[:, q : q + 3].T
        return PairTerms(
            psi=numbers[:, :q],
            a=numbers[:, q + 3 :],
            unforced=unforced,
            most=most,
            margin=margin,
            forces=[c for group in chosen.groups for c in group.rows.results[:, end:].copy()],
            others=chosen.others,
            half=chosen.half,
        )


_HALF = RowPart.HALF.value


def pair_rows(terms: PairTerms, received: Mapping[int, Sequence[float]]) -> Rows:
    """Agent i's rows.

    Args:
        terms: at agent i's sampled state.
        received: û_l, shape (m_l,), of normal agents that count; others count at γ_l^max.
    """
    whole = terms.unforced + terms.most + terms.margin
    half = _HALF * terms.unforced + terms.margin
    bound = -np.where(terms.half, half, whole)
    for k, other in enumerate(terms.others if received else ()):
        if not terms.half[k] and (u := received.get(other)) is not None:
            bound[k] += terms.most[k] - inner(terms.forces[k].tolist(), u)
    return Rows(terms.a, bound, terms.margin, terms.others)


def most_of_other(pair: OwnPair) -> ca.SX:
    """max over the other member's U of c u, scalar."""
    if pair.other is None:
        return ca.SX(0)
    composed = pair.chain.set
    member = composed.members[pair.other]
    x = composed.x[composed.parts[pair.other]]
    polytope = constant_polytope(*member.dynamics.input_polytope(x))
    if polytope is None:
        raise ValueError(
            f"safety.composition: expected input bounds of {member.name} that do not depend on "
            "its state, which one row for each pair needs"
        )
    return ca.mmax(ca.DM(polytope.corners) @ pair.chain.actuation[pair.other].T)
