"""What the report says in numbers, taken from a recording and nothing else."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Array, Index
from phalanx.network.link import LinkModel
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import Pair

_POINTS = 1600
"""Most points of a line: more than the pixels of a figure would show."""


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


@dataclass
class LinkStatistics:
    """What became of the broadcasts on one link, next to what was asked for."""

    sender: str
    receiver: str
    model: LinkModel
    sent: int
    """Broadcasts of the sender."""
    lost: int = 0
    delays: list[float] = field(default_factory=list)
    """Of those not lost [s]."""

    @property
    def decided(self) -> int:
        """Broadcasts whose fate the receiver decided before the run ended."""
        return self.lost + len(self.delays)

    @property
    def loss(self) -> float:
        """Lost share of the decided."""
        return self.lost / self.decided

    @property
    def excess(self) -> float:
        """By how many standard deviations of independent losses it lost more than its model."""
        p, n = self.model.loss, self.decided
        return float((self.lost - n * p) / np.sqrt(n * p * (1.0 - p) + 1.0))


def link_statistics(recording: Recording) -> list[LinkStatistics]:
    """Every link on which a broadcast was decided, in the scenario's order of agents."""
    steps = steps_by_agent(recording)
    decided: dict[tuple[str, str], list[float]] = defaultdict(list)
    for step in recording.steps:
        for sender, _, delay in step.fates:
            decided[sender, step.agent].append(delay)
    found, links = [], recording.scenario.links()
    for sender, receiver in ((a, b) for a in steps for b in steps if (a, b) in decided):
        delays = decided[sender, receiver]
        kept = [delay for delay in delays if delay >= 0.0]
        model = links.model(sender, receiver)
        lost = len(delays) - len(kept)
        found.append(LinkStatistics(sender, receiver, model, len(steps[sender]), lost, kept))
    return found


class Motion:
    """Where everybody was."""

    def __init__(self, recording: Recording, swarm: Swarm) -> None:
        """For a recording with at least one state."""
        x = recording.x
        self.times = recording.times
        """Of the states [s], shape (s,)."""
        self.positions = np.array([swarm.positions(state) for state in x])
        """Output positions [m], shape (s, N, 2) or (s, N, 3)."""
        self.worst = int(np.argmax(recording.h_tot))
        """Index of the state with the largest h_tot."""
        self._static = recording.scenario.static

    def distance(self, pair: Pair) -> Array:
        """Distance between a pair's output points, or from a center or a wall [m], (s,).

        0 from a limit: it is everywhere.
        """
        own = self.positions[:, pair.a]
        if pair.b is None:
            return self._static[pair.obstacle or 0].distances(own)
        apart: Array = np.linalg.norm(own - self.positions[:, pair.b], axis=1)
        return apart


class WorstPairs(NamedTuple):
    """The pair with the largest h at each state."""

    h: Array
    """Its h, shape (s,)."""
    pairs: Index
    """Its sides as SwarmPairs has them, shape (s, 2)."""


def worst_pairs(recording: Recording, swarm: Swarm) -> WorstPairs:
    """Which pair was worst at each state; needs a state."""
    chosen = swarm.pairs.choose(swarm.pairs.among(range(len(swarm.members))))
    found = [(h.max(), h.argmax()) for h in map(chosen.h, recording.x)]
    h, which = zip(*found, strict=True)
    return WorstPairs(np.array(h), chosen.pairs[list(which)])


class Nearest(NamedTuple):
    """How near others came to agents."""

    distances: Array
    """From each agent to whatever was nearest at each state [m], shape (s, n)."""
    closest: list[tuple[Pair, float]]
    """The pairs that came closest over the run, and how close [m], the closest first."""


def nearest(motion: Motion, pairs: Sequence[Pair], agents: Sequence[int], most: int) -> Nearest:
    """What of these pairs came nearest to these agents, and the `most` closest pairs.

    A pair's distances are made, used and dropped: those of all pairs would be too many to keep.
    """
    least = np.empty(len(pairs))
    shortest = {l: np.full(len(motion.times), np.inf) for l in agents}
    for place, pair in enumerate(pairs):
        distance = motion.distance(pair)
        least[place] = distance.min()
        for l in (pair.a, pair.b):
            if l in shortest:
                np.minimum(shortest[l], distance, out=shortest[l])
    order = np.argsort(least, kind="stable")[:most]
    closest = [(pairs[k], float(least[k])) for k in order]
    return Nearest(np.array(list(shortest.values())).T, closest)


def extremes_kept(y: Array, points: int = _POINTS) -> NDArray[np.intp]:
    """Indices that draw y, shape (s,), with fewer points yet show every peak; NaN is a gap."""
    if len(y) <= points:
        return np.arange(len(y))
    size = -(-len(y) // (points // 2))
    places = np.minimum(np.arange(-(-len(y) // size) * size), len(y) - 1).reshape(-1, size)
    values = y[places]
    rows = np.arange(len(places))
    lowest = places[rows, np.where(np.isnan(values), np.inf, values).argmin(axis=1)]
    highest = places[rows, np.where(np.isnan(values), -np.inf, values).argmax(axis=1)]
    return np.unique(np.concatenate([[0], lowest, highest, [len(y) - 1]]))
