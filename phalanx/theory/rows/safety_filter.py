"""Safety filters: from an agent's nominal input to a safe one.

A filter is a row or rows, a QP and a backup. The information model chooses the received inputs of
other agents that its rows contain::

    u_nom ─┐
    rows ──┼─> QP: nearest u in U_i with a_r u <= bound_r ──> u
    U_i ───┘         └─ none ─> backup: argmin over U_i of max_r (a_r u - bound_r)
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from phalanx.theory.arrays import Array
from phalanx.theory.rows.decision import AT_BOUND, Decision, decide, decide_pairs
from phalanx.theory.rows.information import Information, ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import OwnPairTerms, pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Row, Rows, Terms, paper_row
from phalanx.theory.safety.pairs import SwarmPairs


class FilterInput(Struct, frozen=True):
    """Agent i's knowledge at one control step."""

    t: float
    """Time from which the agent's input is in force [s]."""
    x: Array
    """Stacked sampled state, shape (n̄,); NaN for members that are not seen."""
    seen: tuple[int, ...]
    """The members that are seen."""
    terms: Terms
    """Terms of h_tot at that state."""
    u_nom: Array
    """Nominal input, shape (m_i,)."""
    received: Mapping[int, ReceivedInput]
    """û_l by agent."""


class Filtered(Struct, frozen=True):
    """An input, and the rows and received inputs that it rests on."""

    decision: Decision
    used: list[int]
    """The agents whose û_l was in a row."""
    rows: Row | Rows | None = None
    """None for an adversary."""


class SafetyFilter(Protocol):
    """A function that makes one agent's inputs safe."""

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""


class ComposedFilter:
    """One row for h_tot, (QPdistributed) and (psiQPdistributed)."""

    def __init__(
        self, i: int, information: Information, qp: NearestInput, pairs: SwarmPairs
    ) -> None:
        self.i, self._information, self._qp = i, information, qp
        self._own_pairs = lru_cache(maxsize=4)(lambda seen: pairs.choose(pairs.of(i, seen)))

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""
        terms, c, counted = now.terms, now.terms.c, _believed(self._information, now)
        row = paper_row(terms, self.i, counted)
        decision = decide(terms, self.i, row, now.u_nom, self._qp)
        if decision.residual is None or decision.residual >= -AT_BOUND * (1.0 + abs(row.bound)):
            decision = replace(decision, binding=self._weightiest(now))
        return Filtered(decision, [l for l in counted if l in c and any(c[l].tolist())], row)

    def _weightiest(self, now: FilterInput) -> tuple[int, ...]:
        """The other of the agent's own pair that counts most in h_tot, if it has one in sight."""
        pairs = self._own_pairs(now.seen)
        ends = pairs.pairs[[pairs.h(now.x).argmax()]] if len(pairs.pairs) else pairs.pairs
        return tuple([b if a == self.i else a for a, b in ends.tolist()])


class PairwiseFilter:
    """One row for each pair of the agent's own that it sees."""

    def __init__(
        self, i: int, information: Information, qp: NearestInput, terms: OwnPairTerms
    ) -> None:
        """terms: of agent i's pairs."""
        self.i, self._information, self._qp, self._terms = i, information, qp, terms

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""
        rows, used = self._rows(now)
        decision = decide_pairs(now.terms.polytopes[self.i], rows, now.u_nom, self._qp)
        return Filtered(decision, used, rows)

    def _rows(self, now: FilterInput) -> tuple[Rows, list[int]]:
        """A row for each pair, and the agents whose û_l is in one."""
        information, i = self._information, self.i
        if information.shares:
            sharing = information.sharing(i, now.received, now.t, now.seen)
            return pair_rows(self._terms(now.x, now.seen, sharing), {}), []
        counted = _believed(information, now)
        return pair_rows(self._terms(now.x, now.seen), counted), list(counted)


def _believed(information: Information, now: FilterInput) -> dict[int, tuple[float, ...]]:
    """û_l by agent, where it counts; an input that l's actuators do not take must be false."""
    usable, polytopes = information.usable(now.received, now.t), now.terms.polytopes
    return {l: u for l, u in usable.items() if polytopes[l].takes(u)}


class Unfiltered:
    """Projection of an adversary's input onto U_j, with no regard to safety."""

    def __init__(self, i: int, qp: NearestInput) -> None:
        self._i, self._qp = i, qp

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply. Raises ArithmeticError if the projection fails."""
        u = self._qp.solve(now.u_nom, now.terms.polytopes[self._i])
        if u is None:
            raise ArithmeticError(
                f"its input {now.u_nom} at t = {now.t:g} cannot be brought within its input "
                "polytope: check input_polytope"
            )
        return Filtered(Decision(u, Origin.ATTACK, 0.0), [])
