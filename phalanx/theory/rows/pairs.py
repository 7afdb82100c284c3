"""One row for each pair of an agent, in place of one row for the composed h_tot.

S is the intersection of the pairs' own sets, so that keeping every pair keeps S. A pair with an
adversary or an obstacle is the normal agent's alone. A pair of normal agents is a joint condition
of two: both keep half of it (split), or one counts on the other as the information model says.
Constant halves add up at every instant, although the two agents sample at different ones; and no
weights switch, which is why the rigorous margin is several times smaller than that of LSE.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.rows.row import Rows
from phalanx.theory.rows.unseen import with_unseen_far
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.composition import ComposedSet

Array = NDArray[np.float64]


class OwnPair(NamedTuple):
    """A pair of agent i's, as its rows need it."""

    chain: Chain
    """Of the pair alone."""
    own: int
    """Agent i's place in the pair: 0 or 1."""
    other: int | None
    """The other member's index in the swarm; None for an obstacle."""
    shared: bool
    """Whether the other is a normal agent, which has a part in it."""
    number: int
    """Of the pair in the composed set."""


class PairTerms(NamedTuple):
    """Numbers of one sampled state, by pair of agent i; shapes (r,) unless said."""

    psi: Array
    """ψ_0 ... ψ_{q-1} of each pair, shape (r, q)."""
    a: Array
    """L_g ψ_{q-1}^{x_i}, shape (r, m_i)."""
    unforced: Array
    """Σ drift + α_q."""
    most: Array
    """max over U_l of c_l u of the other member; 0 for an obstacle."""
    margin: Array
    """Of the whole row, as margins.margin.Margin sums it."""
    half_margin: Array
    """Of agent i's half of a pair of two normal agents; 0 for other pairs."""
    near: Array
    """1 within the neighbourhood, else 0."""
    others: list[Array]
    """c_l of the other member, shapes (m_l,); empty for an obstacle."""


def own_pairs(composed: ComposedSet, chains: Mapping[int, Chain], i: int) -> list[OwnPair]:
    """The pairs of normal agent i. chains: each pair's own chain, by index."""
    found = []
    for index, chain in chains.items():
        pair = composed.pairs[index]
        if i not in (pair.a, pair.b):
            continue
        other = pair.b if pair.a == i else pair.a
        shared = other is not None and not composed.members[other].adversary
        found.append(OwnPair(chain, 0 if pair.a == i else 1, other, shared, index))
    return found


class PairTermsFunction:
    """Compiles agent i's pairs once, into one function."""

    def __init__(
        self,
        composed: ComposedSet,
        pairs: Sequence[OwnPair],
        margins: Sequence[tuple[ca.SX, ca.SX]],
        active: ca.SX | None = None,
        parameters: Sequence[ca.SX] = (),
    ) -> None:
        """Compile.

        Args:
            composed: the safe set that the pairs belong to.
            pairs: agent i's own.
            margins: of the whole row and of the half, for each pair.
            active: which pairs count at a state, as ComposedSet.substitute has it.
            parameters: symbols in the margins beside the state.
        """
        columns = [
            ca.vertcat(ca.sum1(p.chain.drift) + p.chain.alpha, _most(p), whole, half)
            for p, (whole, half) in zip(pairs, margins, strict=True)
        ]
        near = [ca.SX(1) if active is None else active[p.number] for p in pairs]
        others = [p.chain.actuation[1 - p.own] for p in pairs if p.other is not None]
        outputs = [
            ca.horzcat(*[ca.vertcat(*p.chain.psi) for p in pairs]).T,
            ca.vertcat(*[p.chain.actuation[p.own] for p in pairs]),
            ca.horzcat(*columns),
            ca.vertcat(*near),
            *others,
        ]
        self._parts = composed.parts
        self._shape = (len(pairs), len(pairs[0].chain.psi))
        self._inputs = pairs[0].chain.actuation[pairs[0].own].numel()
        self._with_member = [k for k, p in enumerate(pairs) if p.other is not None]
        self._evaluate = CompiledFunction([composed.x, *parameters], outputs)

    def __call__(
        self, x: Array, *parameters: float, seen: Sequence[int] | None = None
    ) -> PairTerms:
        """Evaluate at a stacked state x, shape (n̄,), and the parameters' values.

        Only the members seen are known; None for all.
        """
        known = with_unseen_far(x, self._parts, seen)
        psi, a, columns, near, *members = self._evaluate(known, *parameters)
        unforced, most, whole, half = columns.reshape(4, -1)
        others = [np.zeros(0)] * self._shape[0]
        for k, c in zip(self._with_member, members, strict=True):
            others[k] = c
        a = a.reshape(self._shape[0], self._inputs)
        return PairTerms(psi.reshape(self._shape), a, unforced, most, whole, half, near, others)


def pair_rows(
    terms: PairTerms,
    pairs: Sequence[OwnPair],
    received: Mapping[int, Array],
    sharing: Sequence[int],
) -> Rows:
    """Agent i's rows.

    Args:
        terms: at agent i's sampled state.
        pairs: the same that terms were compiled for.
        received: û_l, shape (m_l,), of normal agents that count; others count at γ_l^max.
        sharing: normal agents that keep their half; empty unless the model is split.
    """
    bound = -(terms.unforced + terms.most + terms.margin)
    for k, pair in enumerate(pairs):
        if pair.shared and pair.other in sharing:
            bound[k] = -(RowPart.HALF.value * terms.unforced[k] + terms.half_margin[k])
        elif pair.other is not None and (u := received.get(pair.other)) is not None:
            bound[k] += terms.most[k] - float(dot(terms.others[k], u))
    bound[terms.near == 0.0] = np.inf
    return Rows(terms.a, bound)


def _most(pair: OwnPair) -> ca.SX:
    """max over the other member's U of c u, scalar."""
    if pair.other is None:
        return ca.SX(0)
    other = 1 - pair.own
    member = pair.chain.set.members[other]
    known = constant_polytope(
        *member.dynamics.input_polytope(pair.chain.set.x[pair.chain.set.parts[other]])
    )
    if known is None:
        raise ValueError(
            f"safety.composition: expected input bounds of {member.name} that do not depend on "
            "its state, which one row for each pair needs"
        )
    return ca.mmax(ca.DM(known.corners) @ pair.chain.actuation[other].T)
