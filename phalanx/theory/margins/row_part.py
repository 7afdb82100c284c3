"""How much of a joint condition one agent's row keeps: all of it, or its half of a pair."""

from enum import Enum


class RowPart(Enum):
    """The part of a condition that a row keeps; the value is its share of drift, α_q and η."""

    WHOLE = 1.0
    """Σ drift + c_i u_i + Σ_{l≠i} c_l w_l + α_q, every other input w_l a fixed one in U_l: it
    serves û_l in force as well as the worst case."""
    HALF = 0.5
    """c_i u_i + ½ (Σ drift + α_q): each of two normal agents keeps one half of their pair."""
