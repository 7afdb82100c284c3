"""The space-time diagram of a recorded run: a lane for each agent."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phalanx.recording.broadcasts import LATE, LOST, Broadcast
from phalanx.viewer.feeds.history import EMPTY_CODES, AgentSeries
from phalanx.viewer.plots.content import LANE_STATES, Lane

Array = NDArray[np.float64]

_MOST_INTERVALS = 200
_SILENT = LANE_STATES.index("silent")


def lanes(
    found: Sequence[Broadcast], steps: Sequence[AgentSeries], taus: Sequence[float],
    begin: float, end: float,
) -> list[Lane]:  # fmt: skip
    """Every agent's lane between two times [s]."""
    intervals = int(np.clip(max(len(s.t) for s in steps), 1, _MOST_INTERVALS))
    edges, agents = np.linspace(begin, end, intervals + 1), np.arange(len(steps) + 1) - 0.5
    sent = np.array([(b.receiver, b.sent) for b in found]).reshape(-1, 2)
    fate = np.array([b.fate for b in found])

    def counted(these: Array) -> Array:
        return np.asarray(np.histogram2d(these[:, 0], these[:, 1], [agents, edges])[0])

    every = counted(sent)
    late, lost = (
        np.ceil(9.0 * counted(sent[fate == f]) / np.maximum(every, 1.0)) for f in (LATE, LOST)
    )
    return [
        Lane(_digits(late[i]), _digits(lost[i]), _digits(_states(s, tau, edges)))
        for i, (s, tau) in enumerate(zip(steps, taus, strict=True))
    ]


def _states(steps: AgentSeries, tau: float, edges: Array) -> Array:
    """The gravest state in each interval, as a place in LANE_STATES."""
    found = np.zeros(len(edges) - 1)
    until = np.append(steps.t[1:], edges[-1])
    for begin, end, code in zip(steps.t, until, steps.empty, strict=True):
        if code:
            kind = next(kind for kind, value in EMPTY_CODES.items() if value == code)
            _mark(found, edges, begin, min(end, begin + tau), LANE_STATES.index(kind))
        if end - begin > 1.5 * tau:
            _mark(found, edges, begin + tau, end, _SILENT)
    return found


def _mark(found: Array, edges: Array, begin: float, end: float, state: int) -> None:
    first = max(int(np.searchsorted(edges, begin, side="right")) - 1, 0)
    cells = slice(first, max(int(np.searchsorted(edges, end)), first + 1))
    found[cells] = np.maximum(found[cells], state)


def _digits(values: Array) -> str:
    return "".join(map(str, values.astype(int).tolist()))
