"""Kinds of margins of a pair's row: four that a scenario names, and a user's own."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import casadi as ca

from phalanx.theory.expressions.user_methods import call_for_expression
from phalanx.theory.margins.integrated import RowPart, integrated_margin
from phalanx.theory.margins.local import local_margin
from phalanx.theory.safety.chain import Chain


class PairRow(NamedTuple):
    """One agent's row of one pair, the argument of a margin.

    The row is c_i u_i + share (Σ drift + α_q) + margin <= 0. A whole row, with share 1, also
    contains the other member's part of ψ_q.
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
    """

    def at_sample(self, row: PairRow) -> ca.SX:
        """Return the margin at the sampled state, scalar, in the unit of h per second to the q.

        It is added to ψ_q in one agent's row of one pair, times safety.margin_scale: a positive one
        makes the row stricter. ψ_1 ... ψ_{q-1} allow for the disturbance; D_q is chain.disturbance,
        and only in the row if the margin adds it. The chain of one pair serves all pairs of members
        of the same two groups.
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


@dataclass(frozen=True)
class LocalMargin:
    """A bound computed at each sample, of any row."""

    def at_sample(self, row: PairRow) -> ca.SX:
        return local_margin(row.chain, row.own, row.horizon, row.bounds, row.part)


@dataclass(frozen=True)
class IntegratedMargin:
    """A smaller bound computed at each sample, of a pair's row with a linear α_q."""

    def at_sample(self, row: PairRow) -> ca.SX:
        return integrated_margin(row.chain, row.own, row.horizon, row.bounds, row.part)


@dataclass(frozen=True)
class MarginOfInput:
    """The least proven margin for the one input that the agent holds."""

    held: ca.SX
    """Symbols of the input, shape (m_i,)."""

    def at_sample(self, row: PairRow) -> ca.SX:
        return integrated_margin(row.chain, row.own, row.horizon, row.bounds, row.part, self.held)


class UsersMargin:
    """A user's own margin, checked to be a scalar expression of the pair."""

    def __init__(self, margin: Margin) -> None:
        self.margin = margin

    def at_sample(self, row: PairRow) -> ca.SX:
        """Return its margin, NaN where it is infinite, so that no input satisfies the row.

        Raises:
            MistakenMethodError: it returned something else, raised, or does not return.
        """
        known = [part for part in (row.horizon,) if isinstance(part, ca.SX)]
        symbols = [row.chain.set.x, row.chain.set.parameters, *known]
        found = call_for_expression(self.margin, "at_sample", [()], row, symbols=symbols)
        return ca.if_else(ca.fabs(found) < ca.inf, found, math.nan)
