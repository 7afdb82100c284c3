"""The moments of a run that ask for an explanation."""

from collections.abc import Sequence

import numpy as np

from phalanx.guarantee.verdict import Deadlock, waiting_in_words
from phalanx.launcher.engine import EngineError
from phalanx.recording.metrics.measures import deadlocks_of
from phalanx.recording.read import Recording, swarm_of
from phalanx.scenario.load import inline
from phalanx.theory.expressions.exact import length
from phalanx.theory.rows.origin import OF_CONTROLLERS, Origin

_BY_ROWS = frozenset(Origin) - {Origin.ATTACK, *OF_CONTROLLERS}
"""Origins of inputs that rows decided."""


def worst(recording: Recording, agent: str | None = None) -> tuple[str, float]:
    """Return whose input was farthest from its wish, and the time of that sample [s].

    agent: one agent alone. Raises EngineError: no agent has a wish.
    """
    steps = [
        step
        for step in recording.steps
        if step.u_nom and step.origin in _BY_ROWS and agent in (None, step.agent)
    ]
    if not steps:
        raise EngineError("the recording holds no input of a normal agent, or of no such agent")
    away = [float(length(np.subtract(step.u, step.u_nom))) for step in steps]
    step = steps[int(np.argmax(away))]
    return step.agent, step.t


def stuck(recording: Recording, agent: str | None = None) -> tuple[str, float, list[Deadlock]]:
    """Return who waited longest, the middle of that time [s], and all deadlocks.

    agent: one agent alone. Raises EngineError: no agent waited.
    """
    deadlocks = deadlocks_of(recording, swarm_of(recording))
    deadlocks = [deadlock for deadlock in deadlocks if agent in (None, deadlock.agent)]
    if not deadlocks:
        raise EngineError("no agent stood for long though it wanted to move")
    longest = max(deadlocks, key=lambda deadlock: deadlock.end - deadlock.begin)
    return longest.agent, 0.5 * (longest.begin + longest.end), deadlocks


def who_waits(recording: Recording, deadlocks: Sequence[Deadlock]) -> list[str]:
    """Say who waited for whom and, of several, name the law with which their group passes."""
    lines = [f"Who waited for whom: {waiting_in_words(deadlocks)}."]
    agent, others = deadlocks[0].agent, {deadlock.agent for deadlock in deadlocks[1:]}
    groups = enumerate(recording.scenario.agents)
    number, group = next((n, group) for n, group in groups if agent in group.names)
    if others - {agent} and group.law["type"] != "unstick":
        law = inline({"type": "unstick", "of": group.law})
        lines.append(
            "Robots that wait for one another pass by a detour, which changes no row: "
            f"--set 'agents.{number}.law={law}'"
        )
    return lines
