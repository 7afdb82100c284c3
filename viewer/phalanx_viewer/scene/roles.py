"""How agents are coloured: by what they are, and by how their last input was made."""

from enum import StrEnum

from phalanx.faults.commands import Condition
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import AgentStatus


class Role(StrEnum):
    """What an agent's colour says."""

    NORMAL = "normal"
    ADVERSARY = "adversary"
    BACKUP = "backup"
    NO_AUTHORITY = "no authority"
    SILENT = "silent or dead"


COLOURS: dict[Role, tuple[int, int, int]] = {
    Role.NORMAL: (29, 78, 216),
    Role.ADVERSARY: (205, 20, 32),
    Role.BACKUP: (234, 115, 0),
    Role.NO_AUTHORITY: (126, 50, 230),
    Role.SILENT: (120, 130, 145),
}


def role(status: AgentStatus, adversary: bool) -> Role:
    """An agent's role now; adversary: from the start."""
    if status.condition.silent:
        return Role.SILENT
    if adversary or status.condition == Condition.TURNED:
        return Role.ADVERSARY
    origin = status.step.origin if status.step else None
    if origin == Origin.BACKUP:
        return Role.BACKUP
    return Role.NO_AUTHORITY if origin == Origin.NO_AUTHORITY else Role.NORMAL
