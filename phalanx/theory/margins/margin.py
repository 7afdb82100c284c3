"""The margin of a row: what it adds to ψ_q so that it holds until its agent samples again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from phalanx.theory.margins.integrated import integrated_margin
from phalanx.theory.margins.local import local_margin
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.safety.chain import Chain

MarginKind = Literal["paper", "corrected", "local", "integrated"]


@dataclass(frozen=True)
class Margin:
    """How the margin of every row of one agent is made; `of` is the only place that sums it."""

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

    @property
    def symbols(self) -> list[ca.SX]:
        """What its expressions contain beside the state: the horizon, if it is a symbol."""
        return [self.horizon] if isinstance(self.horizon, ca.SX) else []

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
        return self.scale * (part.value * self.eta + self._at_state(chain, own, part, active))

    def _at_state(self, chain: Chain, own: int, part: RowPart, active: ca.SX | None) -> ca.SX:
        bounds = [self.bounds[m.name] for m in chain.set.members]
        if self.kind == "integrated":
            return integrated_margin(chain, own, self.horizon, bounds, part)
        if self.kind == "local":
            return local_margin(chain, own, self.horizon, bounds, part, active)
        if chain.relative_degree == 1:
            return ca.SX(0)  # what the disturbance adds to h's rate is in η already
        return chain.disturbance * part.value
