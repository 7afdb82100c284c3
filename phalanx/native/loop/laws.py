"""The laws and attacks of a run as tables: which law, and the functions of its formulas."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from phalanx.native.loop.kernels import Kernels, begins
from phalanx.native.loop.memory import MOST_INPUTS, Memory, fields_of
from phalanx.native.loop.terms import terms_memory
from phalanx.theory.laws.attacks import Chase, Script, WorstCase
from phalanx.theory.laws.law import Law
from phalanx.theory.laws.tracking import Pursue, Track, TrackVelocity

STEERED, PURSUE, CHASE, WORST, SCRIPT = range(5)
KNOWN = TrackVelocity, Track, Pursue, Chase, WorstCase, Script
"""Laws that the loop has."""


class LawTable(NamedTuple):
    """An agent's law."""

    kind: int
    kernels: Sequence[int]
    """By target, then that of none."""
    goal_numbers: int = 0
    """So many of the goal's are arguments."""
    target: int = -1
    script: tuple[Sequence[float], Sequence[Sequence[float]]] = (), ()
    """Times [s], and the inputs from then on."""
    team: Memory | None = None
    """Terms of those that the agent guards itself against."""
    place: int = 0
    """In the team."""
    margin: float = 0.0


def law_table(kernels: Kernels, law: Law, axes: int, agents: int) -> LawTable:
    """Return the table of a law among the known ones."""
    alone = [0] * agents
    match law:
        case TrackVelocity():
            return LawTable(STEERED, [*alone, kernels(law.formula)], 2 * axes)
        case Track():
            return LawTable(STEERED, [*alone, kernels(law.formula)], 3 * axes)
        case Pursue():
            return LawTable(PURSUE, [*alone, kernels(law.formula)])
        case Chase():
            target = -1 if law.target is None else law.target
            table = LawTable(CHASE, [*map(kernels, law.pursue), kernels(law.stay)], target=target)
            if law.team is None:
                return table
            members = law.team.agents
            terms = terms_memory(kernels, [law.team.terms] * len(members), members)
            margin = law.team.terms.margin
            return table._replace(team=terms, place=law.team.place, margin=margin)
        case WorstCase():
            return LawTable(WORST, [*alone, 0])
        case Script():
            return LawTable(SCRIPT, [*alone, 0], script=(law.at, law.inputs))
    raise ValueError(f"expected a law that the loop has, got {law}")


def law_tables(laws: Sequence[LawTable]) -> dict[str, Any]:
    """Return the tables of all agents' laws: those that run.h declares from law to team_margin."""
    nothing = np.zeros(len(fields_of("Terms")), np.uint64)
    inputs = [u for law in laws for u in law.script[1]]
    return {
        "law": [law.kind for law in laws],
        "goal_numbers": [law.goal_numbers for law in laws],
        "wish": [law.kernels for law in laws],
        "target": [law.target for law in laws],
        "script_at": begins(len(law.script[0]) for law in laws),
        "script_begin": [t for law in laws for t in law.script[0]],
        "script": [[*u, *[0.0] * (MOST_INPUTS - len(u))] for u in inputs],
        "team": np.concatenate([law.team.words if law.team else nothing for law in laws]),
        "team_member": [law.place for law in laws],
        "team_margin": [law.margin for law in laws],
    }
