"""Process faults: agents crash, are restarted, are suspended, or become adversaries.

Each has the effect of commands; see phalanx/faults/commands.py.
"""

from collections.abc import Mapping
from typing import Literal

from phalanx.faults.commands import CommandKind
from phalanx.faults.fault import AgentFacts, AgentFault, FieldPath, TemporaryAgentFault
from phalanx.schema.fields import field_error


class KillFault(AgentFault):
    """Processes are killed (SIGKILL)."""

    kind: Literal["kill"]
    begins_with = CommandKind.KILL


class RestartFault(TemporaryAgentFault):
    """Processes are killed and replaced later, by processes that have received nothing."""

    kind: Literal["restart"]
    begins_with, ends_with = CommandKind.KILL, CommandKind.RESTART


class PauseFault(TemporaryAgentFault):
    """Processes are suspended: they neither sample, answer nor receive."""

    kind: Literal["pause"]
    begins_with, ends_with = CommandKind.FREEZE, CommandKind.THAW


class AttackFault(AgentFault):
    """Normal agents become adversaries, permanently."""

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError for an agent that is not normal."""
        super().check(agents, where)
        for name in self.agents or agents:
            if agents[name].adversary:
                raise field_error((*where, "agents"), "expected normal agents", name)


class TurnFault(AttackFault):
    """Adversaries that broadcast what they apply."""

    kind: Literal["turn"]
    begins_with = CommandKind.TURN


class HijackFault(AttackFault):
    """Adversaries that broadcast what they would have applied."""

    kind: Literal["hijack"]
    begins_with = CommandKind.HIJACK


ProcessFault = KillFault | RestartFault | PauseFault | TurnFault | HijackFault
