"""The margin of a row: an addition to ψ_q so that it holds until its agent samples again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import casadi as ca

from phalanx.theory.margins.integrated import RowPart
from phalanx.theory.margins.kinds import Margin, PairRow
from phalanx.theory.safety.chain import Chain

_Number = TypeVar("_Number", float, ca.SX)


class ComposedMargin(NamedTuple):
    """The margin of a row for h_tot that is composed from pairs: scale (η + D_q)."""

    eta: float
    scale: float = 1.0

    def total(self, at_state: _Number, share: float = 1.0) -> _Number:
        """scale (share η + at_state), where at_state is the part that depends on the state.

        The only place that sums a margin.
        """
        return self.scale * (share * self.eta + at_state)


@dataclass(frozen=True)
class AgentMargin:
    """Make the margin of every row of one agent."""

    kind: Margin
    eta: float
    """η(Γ_i + δ^max), given or from constants; 0 where the margin is computed at each sample."""
    scale: float
    """Factor of the sum; below 1 nothing is proven."""
    horizon: float | ca.SX
    """Longest time after a sample that the agent's input may be in force [s]."""
    bounds: Mapping[str, float]
    """φ_l^max of every member by name."""
    symbols: tuple[ca.SX, ...] = ()
    """Symbols in its expressions other than the state."""

    def of(self, chain: Chain, own: int, part: RowPart = RowPart.WHOLE) -> ca.SX:
        """The margin of a row as an expression of the sampled state, scalar.

        Args:
            chain: of a pair, or of the composed set where the margin is the paper's or corrected.
            own: the place of the row's agent among the chain's members.
            part: of the joint condition that the row keeps.

        Raises:
            ValueError: the margin is local or integrated, and some U_l depends on the
                state or some operation has no interval rule.
            MistakenMethodError: a user's margin failed, or returned no scalar expression.
        """
        row = PairRow(chain, own, part, self.horizon, self.bounds_of(chain))
        return self.given.total(self.kind.at_sample(row), part.value)

    def bounds_of(self, chain: Chain) -> tuple[float, ...]:
        """φ_l^max of each of the chain's members."""
        return tuple(self.bounds[m.name] for m in chain.set.members)

    @property
    def given(self) -> ComposedMargin:
        """The part of a row's margin that is the same at every state."""
        return ComposedMargin(self.eta, self.scale)
