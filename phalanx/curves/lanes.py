"""The space-time diagram: a lane for each agent, with the fates of the broadcasts to it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.curves.history import EMPTY_CODES, AgentSeries, History
from phalanx.recording.broadcasts import window

LANE_STATES = ("fine", "backup", "no-authority", "silent")
"""The gravest last. Silent: no step for longer than its τ."""
_SILENT = LANE_STATES.index("silent")


class Lanes(NamedTuple):
    """Every agent's lane over the same intervals of time; each of shape (N, c)."""

    late: Array
    """Share of the broadcasts to it that came too late for its next step."""
    lost: Array
    """Share of the broadcasts to it that were lost."""
    state: Index
    """Its gravest state, as a place in LANE_STATES."""
    false: Array
    """1 where it sent a false broadcast, else 0."""


def lanes(
    history: History, steps: Sequence[AgentSeries], taus: Sequence[float],
    span: tuple[float, float], now: float, most: int,
) -> Lanes:  # fmt: skip
    """Compute every agent's lane.

    Args:
        history: of the run.
        steps: of every agent.
        taus: longest time without a step before each agent counts as silent [s].
        span: begin and end of the diagram [s].
        now: the latest time known of the run [s].
        most: intervals at most.
    """
    intervals = int(np.clip(max(len(s.t) for s in steps), 1, most))
    shape, (begin, end) = (len(steps), intervals), span

    def counted(agents: Array, t: Array, counts: Array) -> Array:
        at = np.clip(intervals * (t - begin) / (end - begin), 0, intervals - 1).astype(int)
        cells = intervals * agents.astype(int) + at
        total = np.bincount(cells, counts, shape[0] * intervals).reshape(shape)
        return total.astype(float)

    fates = history.fates
    sent, late, lost = (
        counted(fates.receiver, fates.t, counts) for counts in (fates.sent, fates.late, fates.lost)
    )
    false = history.broadcasts[history.broadcasts.false]
    edges = np.linspace(begin, end, intervals + 1)
    return Lanes(
        late / np.maximum(sent, 1.0),
        lost / np.maximum(sent, 1.0),
        np.array([_states(s, tau, edges, now) for s, tau in zip(steps, taus, strict=True)]),
        np.minimum(counted(false.sender, false.sent, np.ones(len(false))), 1.0),
    )


def zoom_window(steps: Sequence[AgentSeries], worst: float, end: float) -> tuple[float, float]:
    """Begin and end of a few control steps around the worst moment of a run [s]."""
    return window(worst, end, [s.sampled.tolist() for s in steps])


def _states(steps: AgentSeries, tau: float, edges: Array, now: float) -> Index:
    """Find the gravest state in each interval, as a place in LANE_STATES."""
    found = np.zeros(len(edges) - 1, dtype=np.intp)
    until = np.append(steps.sampled[1:], now)
    for k in np.flatnonzero((steps.empty > 0.0) | (until - steps.sampled > 1.5 * tau)):
        begin, end, code = steps.sampled[k], until[k], steps.empty[k]
        if code:
            kind = next(kind for kind, value in EMPTY_CODES.items() if value == code)
            _mark(found, edges, begin, min(end, begin + tau), LANE_STATES.index(kind))
        if end - begin > 1.5 * tau:
            _mark(found, edges, begin + tau, end, _SILENT)
    return found


def _mark(found: Index, edges: Array, begin: float, end: float, state: int) -> None:
    first = max(int(np.searchsorted(edges, begin, side="right")) - 1, 0)
    cells = slice(first, max(int(np.searchsorted(edges, end)), first + 1))
    found[cells] = np.maximum(found[cells], state)
