"""The margin of a row: what it adds to ψ_q so that it holds until its agent samples again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

import casadi as ca

from phalanx.theory.margins.integrated import RowPart, integrated_margin
from phalanx.theory.margins.local import local_margin
from phalanx.theory.safety.chain import Chain

MarginKind = Literal["paper", "corrected", "local", "integrated"]


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
class Margin:
    """How the margin of every row of one agent is made."""

    kind: MarginKind
    """As in the paper; corrected, with L_φ ψ_k for every k >= 1; or a proven bound: local, of any
    row, or integrated, of a pair's."""
    eta: float
    """η(Γ_i + δ^max), given or from constants; 0 where the margin is a bound of its own."""
    scale: float
    """What the sum is multiplied with; below 1 nothing is proven."""
    horizon: float | ca.SX
    """How long after a sample the agent's input may be in force [s]."""
    bounds: Mapping[str, float]
    """φ_l^max of every member by name."""
    held: ca.SX | None = None
    """Symbols of the one input that an integrated margin is for; None: any that the row allows."""

    @property
    def symbols(self) -> list[ca.SX]:
        """What its expressions contain beside the state, in this order: horizon, held input."""
        return [s for s in (self.horizon, self.held) if isinstance(s, ca.SX)]

    def of(
        self, chain: Chain, own: int, part: RowPart = RowPart.WHOLE, active: ca.SX | None = None
    ) -> ca.SX:
        """The margin of a row as an expression of the sampled state, scalar.

        Args:
            chain: of the composed set, or of a pair.
            own: the place among the chain's members of the agent whose row it is.
            part: of the joint condition that the row keeps.
            active: which pairs count, as ComposedSet.substitute has it.

        Raises:
            ValueError: the margin is local or integrated, and some U_l depends on the
                state or some operation has no interval rule.
        """
        return self.given.total(self._at_state(chain, own, part, active), part.value)

    @property
    def given(self) -> ComposedMargin:
        """What of a row's margin is the same at every state."""
        return ComposedMargin(self.eta, self.scale)

    def _at_state(self, chain: Chain, own: int, part: RowPart, active: ca.SX | None) -> ca.SX:
        bounds = [self.bounds[m.name] for m in chain.set.members]
        if self.kind == "integrated":
            return integrated_margin(chain, own, self.horizon, bounds, part, self.held)
        if self.kind == "local":
            return local_margin(chain, own, self.horizon, bounds, part, active)
        if chain.relative_degree == 1:
            return ca.SX(0)  # what the disturbance adds to h's rate is in η already
        return chain.disturbance * part.value
