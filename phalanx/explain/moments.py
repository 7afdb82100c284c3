"""The moments of a run that ask for an explanation."""

import numpy as np

from phalanx.launcher.engine import EngineError
from phalanx.recording.metrics.deadlock import Wait
from phalanx.recording.metrics.measures import Thresholds, waits_of_agents
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


def stuck(recording: Recording, agent: str | None = None) -> tuple[str, float, list[str]]:
    """Return who waited longest, the middle of that time [s], and who waits for whom in words.

    agent: one agent alone. Raises EngineError: no agent waited.
    """
    waiting = {
        name: waits
        for name, waits in waits_of_agents(recording, swarm_of(recording), Thresholds()).items()
        if waits and agent in (None, name)
    }
    if not waiting:
        raise EngineError("no agent stood for long though it wanted to move")
    lines = [
        f"Agent {name} waited from {wait.begin:.4g} to {wait.end:.4g} s, nearest to {wait.nearest}."
        for name, waits in waiting.items()
        for wait in waits
    ]
    if len(waiting) > 1:
        lines.append(_cure(recording, next(iter(waiting))))
    name, longest = max(
        ((name, wait) for name, waits in waiting.items() for wait in waits), key=_duration
    )
    return name, 0.5 * (longest.begin + longest.end), lines


def _cure(recording: Recording, agent: str) -> str:
    """Name the law with which an agent's group makes detours."""
    groups = enumerate(recording.scenario.agents)
    number, group = next((n, group) for n, group in groups if agent in group.names)
    law = inline({"type": "unstick", "of": group.law})
    return (
        "Robots that wait for one another pass by a detour, which changes no row: "
        f"--set 'agents.{number}.law={law}'"
    )


def _duration(entry: tuple[str, Wait]) -> float:
    return entry[1].end - entry[1].begin
