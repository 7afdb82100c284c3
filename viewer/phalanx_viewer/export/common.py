"""Contents that the exports for Foxglove and rerun share: the nearest pairs, and the log."""

import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import Recording
from phalanx.recording.records import Level, Log
from phalanx.swarm.swarm import Swarm

_AT_ONCE = 64
"""States whose pairs are evaluated together."""
_LEVELS = {
    Outcome.GUARANTEED: Level.INFO,
    Outcome.SAFE: Level.WARNING,
    Outcome.VIOLATED: Level.ERROR,
    Outcome.BROKEN: Level.ERROR,
    Outcome.STOPPED: Level.INFO,
}


def near_pairs(swarm: Swarm, x: Array) -> tuple[list[int], Array]:
    """Find the pairs that were the worst one of some agent at some state, and their h.

    Args:
        swarm: of the pairs.
        x: states, shape (s, n̄).

    Returns:
        The r pairs' indices in the composed set, and h, shape (s, r).
    """
    pairs = swarm.pairs.every
    every = swarm.pairs.choose(pairs)
    mine = [np.flatnonzero((every.pairs == i).any(axis=1)) for i in swarm.normal]
    worst: set[int] = set()
    for begin in range(0, len(x), _AT_ONCE):
        h = every.h(x[begin : begin + _AT_ONCE])
        for own in mine:
            worst.update(every.order[own[h[:, own].argmax(axis=1)]].tolist() if len(own) else ())
    found = sorted(worst)
    chosen = swarm.pairs.choose(pairs[found])
    h = np.empty((len(x), len(found)))
    h[:, chosen.order] = chosen.h(x)
    return found, h


def log_lines(recording: Recording) -> list[Log]:
    """List events and failed assumptions by time, the verdict last."""
    end = recording.states[-1].t if recording.states else 0.0
    summary, failed = recording.summary, []
    if summary is None:
        verdict = Log(end, f"no verdict: {recording.unfinished}", Level.ERROR)
    else:
        text = f"{summary.outcome}: {summary.reason}"
        verdict = Log(max(summary.t, end), text, _LEVELS[summary.outcome])
        failed = [
            Log(a.first, f"failed: {a.name} ({a.failed} of {a.checked} checks)", Level.WARNING)
            for a in summary.assumptions
            if a.failed and a.first is not None
        ]
    return [*sorted([*recording.log, *failed], key=lambda line: line.t), verdict]
