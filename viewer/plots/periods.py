"""When an agent was on its backup, without authority, or not fine."""

import numpy as np

from phalanx.faults.state import Condition
from phalanx.viewer.feeds.history import EMPTY_CODES, AgentSeries, ConditionChange
from phalanx.viewer.plots.content import Period


def empty_periods(agent: int, steps: AgentSeries) -> list[Period]:
    """From the step at which K_i was empty until the next at which it was not."""
    found = []
    for kind, value in EMPTY_CODES.items():
        held = np.concatenate([[False], steps.empty == value, [False]])
        edges = np.flatnonzero(np.diff(held.astype(int)))
        last = len(steps.t) - 1
        for begin, end in edges.reshape(-1, 2).tolist():
            t, until = steps.t[begin], steps.t[min(end, last)]
            found.append(Period(agent, kind, float(t), float(until)))
    return found


def fault_periods(changes: list[ConditionChange], end: float) -> list[Period]:
    """From each change of condition to the agent's next, or to the end [s]."""
    found = []
    for k, change in enumerate(changes):
        later = (c.t for c in changes[k + 1 :] if c.agent == change.agent)
        if change.condition != Condition.FINE:
            until = next(later, end)
            found.append(Period(change.agent, change.condition, change.t, until))
    return found
