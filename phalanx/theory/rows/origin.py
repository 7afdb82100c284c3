"""How an agent's input was made."""

from enum import StrEnum


class Origin(StrEnum):
    """How an input was made."""

    QP = "qp"
    """The QP had a solution: the input is in K_i."""
    SOLVER_FAILED = "solver-failed"
    """K_i was not empty, but the solver found nothing in it: u_i^min, which keeps every row."""
    BACKUP = "backup"
    """K_i was empty: u_i^min of Eq. (LPnormal)."""
    NO_AUTHORITY = "no-authority"
    """K_i was empty, but the agent cannot move ψ_q: its nominal input, projected onto U_i."""
    ATTACK = "attack"
    """An adversary's input."""


EMPTY = (Origin.BACKUP, Origin.NO_AUTHORITY)
"""The origins of inputs for which K_i was empty."""


def words_of(origin: str) -> str:
    """An origin as a person reads it."""
    return origin.replace("-", " ")
