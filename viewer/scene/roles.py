"""How agents are coloured: by what they are, and by how their last input was made."""

from enum import StrEnum

from phalanx.faults.state import Condition
from phalanx.theory.rows.origin import Origin
from phalanx.wire.frames import AgentStatus


class Role(StrEnum):
    """What an agent's colour says."""

    NORMAL = "normal"
    ADVERSARY = "adversary"
    BACKUP = "backup"
    NO_AUTHORITY = "no authority"
    SILENT = "silent or dead"


COLOURS: dict[Role, tuple[int, int, int]] = {
    Role.NORMAL: (37, 99, 235),
    Role.ADVERSARY: (220, 38, 38),
    Role.BACKUP: (245, 158, 11),
    Role.NO_AUTHORITY: (192, 132, 252),
    Role.SILENT: (148, 163, 184),
}


def role(status: AgentStatus, adversary: bool) -> Role:
    """An agent's role now; adversary: from the start."""
    if status.condition in (Condition.DEAD, Condition.FROZEN):
        return Role.SILENT
    if adversary or status.condition == Condition.TURNED:
        return Role.ADVERSARY
    if status.origin == Origin.BACKUP:
        return Role.BACKUP
    return Role.NO_AUTHORITY if status.origin == Origin.NO_AUTHORITY else Role.NORMAL
