"""The origin of an agent's input: QP, backup, attack, or another controller."""

from collections.abc import Collection, Mapping
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
    BRAKE = "brake"
    """By radio: of its own parts only the brake's was small enough, or it holds its place."""
    FALLBACK = "fallback"
    """With safety.keep: after the input of filter or controller no fallback would have remained."""
    PROVEN = "proven"
    """With safety.prove: the QP also had whole rows, for pairs certified for too short a time."""
    LONGEST = "longest-certified"
    """With safety.prove: no such input was found; of those tried, the one certified for longest."""
    ATTACK = "attack"
    """An adversary's input."""
    CONTROLLER = "controller"
    """Of the controller that the agent's group names in place of the paper's filter."""
    PROJECTED = "controller-projected"
    """The same, but it was outside U_i: projected onto U_i."""


EMPTY = (Origin.BACKUP, Origin.NO_AUTHORITY)
"""The origins of inputs for which K_i was empty."""

OF_NO_ROWS = (*EMPTY, Origin.LONGEST, Origin.FALLBACK)
"""The origins of inputs that no agent's rows made."""

OF_CONTROLLERS = (Origin.CONTROLLER, Origin.PROJECTED)
"""The origins of inputs that no row made: nothing is known of K_i."""

OF_PROOFS = (Origin.PROVEN, Origin.LONGEST)
"""The origins of inputs that replaced one certified for too short a time."""

OF_MODES: Mapping[str, tuple[Origin, ...]] = {
    "controller": OF_CONTROLLERS,
    "radio": (Origin.BRAKE,),
    "prove": OF_PROOFS,
    "keep": (Origin.FALLBACK,),
}
"""The origins that only runs with a mode have: a field of the agents or of [safety]."""


def origins_of_normal(modes: Collection[str] = ()) -> list[Origin]:
    """Return the origins that inputs of normal agents may have in a run with these modes."""
    absent = {Origin.ATTACK}.union(*(OF_MODES[mode] for mode in OF_MODES if mode not in modes))
    return [origin for origin in Origin if origin not in absent]


def origin_label(origin: str) -> str:
    """An origin as readable text."""
    return origin.replace("-", " ")
