"""The margin of a row: an addition to ψ_q so that it holds until its agent samples again.

Four kinds have a name in scenarios, two of them here; others are users' own.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, NamedTuple, Protocol, runtime_checkable

import casadi as ca
from annotated_types import Ge

from phalanx.theory.expressions.user_methods import check_of, require_expression
from phalanx.theory.safety.chain import Chain

NonNegative = Annotated[float, Ge(0)]


@dataclass(frozen=True)
class MarginConstants:
    """The constants of Lemma (constants) and Lemma (xdiffbound), from which η follows."""

    c_f: NonNegative
    c_g: NonNegative
    c_alpha: NonNegative
    c_gamma: NonNegative
    c_h: NonNegative
    u_max: NonNegative
    mu: NonNegative

    def eta(self, gamma: float, disturbances: float) -> float:
        """η(Γ), Eqs. (epsT) and (mainetadef).

        Args:
            gamma: longest time between samples, Γ_i + δ^max [s].
            disturbances: Σ_l φ_l^max.
        """
        rate = self.c_f + self.c_g * self.u_max + self.c_alpha + self.c_gamma
        # ε(Γ) = μ/L' (exp(L' Γ) - 1), Eq. (epsT), for any L' > 0: its limit at 0 is the tightest.
        return rate * (self.mu * gamma) + self.c_h * disturbances


class RowPart(Enum):
    """The part of a condition that a row keeps; the value is its share of drift, α_q and η."""

    WHOLE = 1.0
    """Σ drift + c_i u_i + Σ_{l≠i} c_l w_l + α_q, with a fixed w_l in U_l for every other input:
    for a received input in force as well as for the worst case."""
    HALF = 0.5
    """c_i u_i + ½ (Σ drift + α_q): each of two normal agents keeps one half of their pair."""


class PairRow(NamedTuple):
    """One agent's row of one pair, the argument of a margin.

    The row is c_i u_i + share (Σ drift + α_q) + margin <= 0. A whole row, with share 1, also
    contains the other member's part of ψ_q.

    >>> from phalanx.theory.margins.margin import RowPart
    >>> PairRow(None, 0, RowPart.HALF, horizon=0.02, bounds=(0.0, 0.0)).share
    0.5
    """

    chain: Chain
    """ψ_0 ... ψ_{q-1} of the pair and the parts of ψ_q, as expressions of chain.set.x, the members'
    states one after the other [SI], shape (n̄,). An obstacle's numbers may be symbols too."""
    own: int
    """Place of the row's agent among chain.set.members: 0 or 1."""
    part: RowPart
    """Part of the pair's condition that the row keeps."""
    horizon: float | ca.SX
    """Longest time after the sample that the agent's input may be in force [s]."""
    bounds: tuple[float, ...]
    """φ_l^max of each of chain.set.members: bounds on the norms of their disturbances, in the units
    of x'."""

    @property
    def share(self) -> float:
        """1; or 0.5 where each of two normal agents keeps one half of their pair."""
        return self.part.value


@runtime_checkable
class Margin(Protocol):
    """The margin of a pair's row; a scenario names it ``package.module:Name``.

    A margin of your own is not proven; certificates judge the run all the same.

    >>> class Ample:
    ...     def at_sample(self, row):
    ...         return ca.SX(0.1 * row.share)
    >>> isinstance(Ample(), Margin)
    True
    """

    def at_sample(self, row: PairRow) -> ca.SX:
        """Return the margin at the sampled state, scalar, in the unit of h per second to the q.

        It is added to ψ_q in one agent's row of one pair: a positive one makes the row stricter.
        ψ_1 ... ψ_{q-1} allow for the disturbance; D_q is chain.disturbance, and only in the row if
        the margin adds it. The chain of one pair serves all pairs of members of the same two
        groups.
        """


@dataclass(frozen=True)
class PaperMargin:
    """The constant η, as in the paper; safety.eta has it."""

    def at_sample(self, row: PairRow) -> ca.SX:
        if row.chain.relative_degree == 1:
            return ca.SX(0)  # η contains the disturbance's part of h's rate
        return row.chain.disturbance * row.share


@dataclass(frozen=True)
class CorrectedMargin(PaperMargin):
    """The paper's margin for a chain, and so a row, with L_φ ψ_k for every k >= 1."""


@check_of(Margin, "at_sample")
def _expression(margin: Margin, result: Any, row: PairRow) -> ca.SX:
    """Return a margin, NaN where it is infinite, so that no input satisfies the row."""
    symbols = [row.chain.set.x, row.chain.set.parameters, ca.SX(row.horizon)]
    value = require_expression(margin, "at_sample", [()], result, symbols=symbols)
    return ca.if_else(ca.fabs(value) < ca.inf, value, math.nan)


@dataclass(frozen=True)
class AgentMargin:
    """Make the margin of every row of one agent."""

    kind: Margin
    eta: float
    """η(Γ_i + δ^max), given or from constants; 0 where the margin is computed at each sample."""
    horizon: float | ca.SX
    """Longest time after a sample that the agent's input may be in force [s]."""
    bounds: Mapping[str, float]
    """φ_l^max of every member by name."""
    symbols: tuple[ca.SX, ...] = ()
    """Symbols in its expressions other than the state."""

    def of(self, chain: Chain, side: int, part: RowPart) -> ca.SX:
        """The margin of a row as an expression of the sampled state, scalar.

        Args:
            chain: of a pair.
            side: that of the row's agent in the pair, 0 or 1.
            part: of the pair's condition that the row keeps.

        Raises:
            ValueError: the margin is local or integrated, and some U_l depends on the
                state or some operation has no interval rule.
            MistakenMethodError: a user's margin failed, or returned no scalar expression.
        """
        bounds = tuple(self.bounds[m.name] for m in chain.set.members)
        row = PairRow(chain, side, part, self.horizon, bounds)
        return part.value * self.eta + self.kind.at_sample(row)
