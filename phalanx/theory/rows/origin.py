"""The origin of an agent's input: QP, backup or attack."""

from enum import StrEnum


class Origin(StrEnum):
    """Origin of an agent's input."""

    QP = "qp"
    """The QP had a solution: the input is in K_i."""
    SOLVER_FAILED = "solver-failed"
    """K_i was not empty, but the solver failed: u_i^min, which satisfies every row."""
    BACKUP = "backup"
    """K_i was empty: u_i^min of Eq. (LPnormal)."""
    NO_AUTHORITY = "no-authority"
    """K_i was empty, but the agent cannot move ψ_q: its nominal input, projected onto U_i."""
    ATTACK = "attack"
    """An adversary's input."""


EMPTY = (Origin.BACKUP, Origin.NO_AUTHORITY)
"""The origins of inputs for which K_i was empty."""


def origin_label(origin: str) -> str:
    """An origin as readable text."""
    return origin.replace("-", " ")
