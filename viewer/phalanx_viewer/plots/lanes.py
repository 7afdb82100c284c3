"""The space-time diagram of a run: a lane for each agent, and its worst moment in detail."""

from collections.abc import Sequence

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.recording.broadcasts import Broadcast, window
from phalanx_viewer.feeds.history import EMPTY_CODES, AgentSeries, Fates
from phalanx_viewer.plots.content import FALSE, LANE_STATES, Lane, Zoom

_MOST_INTERVALS = 200
_SILENT = LANE_STATES.index("silent")


def lanes(
    fates: Fates, steps: Sequence[AgentSeries], taus: Sequence[float],
    begin: float, end: float, now: float, broadcasts: Sequence[Broadcast] = (),
) -> list[Lane]:  # fmt: skip
    """Every agent's lane.

    Args:
        fates: of the broadcasts.
        steps: of every agent.
        taus: for how long each may be without a step before it counts as silent [s].
        begin: of the diagram [s].
        end: of the diagram [s].
        now: how far the run has come [s].
        broadcasts: of the whole run, as far as they are known.
    """
    intervals = int(np.clip(max(len(s.t) for s in steps), 1, _MOST_INTERVALS))
    shape, edges = (len(steps), intervals), np.linspace(begin, end, intervals + 1)

    def cells_of(agents: Array, t: Array) -> Index:
        at = np.clip(intervals * (t - begin) / (end - begin), 0, intervals - 1).astype(int)
        found: Index = intervals * agents.astype(int) + at
        return found

    cells = cells_of(fates.receiver, fates.t)
    false = np.array([(b.sender, b.sent) for b in broadcasts if b.false]).reshape(-1, 2)
    lies = np.zeros(len(steps) * intervals)
    lies[cells_of(*false.T)] = 1.0
    sent, late, lost = (
        np.bincount(cells, counts, len(steps) * intervals).reshape(shape)
        for counts in (fates.sent, fates.late, fates.lost)
    )
    late, lost = (np.ceil(9.0 * counts / np.maximum(sent, 1.0)) for counts in (late, lost))
    return [
        Lane(*map(_digits, (late[i], lost[i], _states(s, tau, edges, now), lied)))
        for i, (s, tau, lied) in enumerate(zip(steps, taus, lies.reshape(shape), strict=True))
    ]


def zoom(
    broadcasts: Sequence[Broadcast], steps: Sequence[AgentSeries], worst: float, end: float,
    only: int | None,
) -> Zoom:  # fmt: skip
    """What happened around the worst moment [s].

    Args:
        broadcasts: of the whole run.
        steps: of every agent.
        worst: the worst moment [s].
        end: of the run [s].
        only: the agent whose broadcasts are told; None: everybody's.
    """
    begin, until = window(worst, end, [s.t.tolist() for s in steps])
    seen = [
        (b.sender, b.sent, b.receiver, b.arrival, FALSE if b.false else b.fate)
        for b in broadcasts
        if begin <= b.sent <= until and only in (None, b.sender, b.receiver)
    ]
    return Zoom(begin, until, [s.t[(begin <= s.t) & (s.t <= until)].tolist() for s in steps], seen)


def _states(steps: AgentSeries, tau: float, edges: Array, now: float) -> Array:
    """The gravest state in each interval, as a place in LANE_STATES."""
    found = np.zeros(len(edges) - 1)
    until = np.append(steps.t[1:], now)
    for k in np.flatnonzero((steps.empty > 0.0) | (until - steps.t > 1.5 * tau)):
        begin, end, code = steps.t[k], until[k], steps.empty[k]
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
