"""Faults of processes: agents crash, are restarted, stand still, or become adversaries.

Each is what commands of a person would do: phalanx/faults/commands.py says what those change.
"""

from collections.abc import Mapping
from typing import Literal

from phalanx.faults.commands import CommandKind
from phalanx.faults.fault import AgentFacts, AgentFault, AgentFaultForATime, Where
from phalanx.schema.fields import misplaced


class KillFault(AgentFault):
    """Processes die by kill -9."""

    kind: Literal["kill"]
    begins_with = CommandKind.KILL


class RestartFault(AgentFaultForATime):
    """Processes die by kill -9, and others take their places, later and with nothing received."""

    kind: Literal["restart"]
    begins_with, ends_with = CommandKind.KILL, CommandKind.RESTART


class PauseFault(AgentFaultForATime):
    """Processes stand still: they neither sample, answer nor hear."""

    kind: Literal["pause"]
    begins_with, ends_with = CommandKind.FREEZE, CommandKind.THAW


class TurnFault(AgentFault):
    """Normal agents become adversaries, and stay that."""

    kind: Literal["turn"]
    begins_with = CommandKind.TURN

    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError for one that is no normal agent."""
        super().check(agents, where)
        for name in self.agents or agents:
            if agents[name].adversary:
                raise misplaced((*where, "agents"), "expected normal agents", name)


ProcessFault = KillFault | RestartFault | PauseFault | TurnFault
