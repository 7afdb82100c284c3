"""How an agent's input was made."""

from enum import StrEnum


class Origin(StrEnum):
    """How an input was made."""

    QP = "qp"
    """The QP had a solution: the input is in K_i."""
    BACKUP = "backup"
    """K_i was empty (or the solver failed): u_i^min of Eq. (LPnormal)."""
    NO_AUTHORITY = "no-authority"
    """K_i was empty, but the agent cannot move ψ_q: its nominal input, projected onto U_i."""
    ATTACK = "attack"
    """An adversary's input."""
