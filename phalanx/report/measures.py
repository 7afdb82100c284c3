"""What the report says in numbers: the worst moment, and how near others came."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.curves.history import RecordedHistory
from phalanx.recording.read import Recording
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import Pair


class Worst(NamedTuple):
    """The largest h_tot of a run."""

    h_tot: float
    t: float
    """[s]"""


def worst(recording: Recording) -> Worst | None:
    """The largest h_tot and when; None if there is no state. Without a summary, to an event."""
    if not recording.states:
        return None
    if recording.summary:
        return Worst(recording.summary.worst_h_tot, recording.summary.worst_at)
    state = max(recording.states, key=lambda s: s.h_tot)
    return Worst(state.h_tot, state.t)


def origins(recording: Recording) -> dict[str, int]:
    """Recorded steps of normal agents, by how their input was made."""
    counts = {str(origin): 0 for origin in Origin if origin is not Origin.ATTACK}
    for step in recording.steps:
        if step.origin in counts:
            counts[step.origin] += 1
    return counts


class WorstPairs(NamedTuple):
    """The pair with the largest h at each state."""

    h: Array
    """Its h, shape (s,)."""
    pairs: Index
    """Its sides as SwarmPairs has them, shape (s, 2)."""


def worst_pairs(history: RecordedHistory) -> WorstPairs:
    """Which pair was worst at each state; needs a state."""
    pairs = history.swarm.pairs
    chosen = pairs.choose(pairs.among(range(len(history.swarm.members))))
    found = [(h.max(), h.argmax()) for h in map(chosen.h, history.x)]
    h, which = zip(*found, strict=True)
    return WorstPairs(np.array(h), chosen.pairs[list(which)])


class Nearest(NamedTuple):
    """How near others came to agents."""

    distances: Array
    """From each agent to whatever was nearest at each state [m], shape (s, n)."""
    closest: list[tuple[Pair, float]]
    """The pairs that came closest over the run, and how close [m], the closest first."""


def nearest(
    history: RecordedHistory, pairs: Sequence[Pair], agents: Sequence[int], most: int
) -> Nearest:
    """What of these pairs came nearest to these agents, and the `most` closest pairs.

    A pair's distances are made, used and dropped: those of all pairs would be too many to keep.
    """
    least = np.empty(len(pairs))
    shortest = {l: np.full(len(history.times), np.inf) for l in agents}
    for place, pair in enumerate(pairs):
        distance = history.distance(pair)
        least[place] = distance.min()
        for l in (pair.a, pair.b):
            if l in shortest:
                np.minimum(shortest[l], distance, out=shortest[l])
    order = np.argsort(least, kind="stable")[:most]
    closest = [(pairs[k], float(least[k])) for k in order]
    return Nearest(np.array(list(shortest.values())).T, closest)
