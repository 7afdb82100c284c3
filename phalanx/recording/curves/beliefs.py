"""Beliefs by radio: what agents knew of their peers, followed again from a recording."""

from collections import defaultdict
from itertools import combinations
from typing import NamedTuple

import numpy as np

from phalanx.faults.commands import ProcessChange
from phalanx.knowledge.held import halves
from phalanx.knowledge.motion import stacked
from phalanx.network.inbox import SentInput
from phalanx.recording.curves.series import Series
from phalanx.recording.fates import RecordedFates
from phalanx.recording.read import Recording
from phalanx.swarm.points import agent_point
from phalanx.swarm.radio import PeerKnowledge
from phalanx.swarm.statements import StatementLedger
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.safety.composition import Pair
from phalanx.theory.safety.function import Distance, Separation


class Belief(NamedTuple):
    """An agent's belief of where a peer is."""

    peer: int
    age: float
    """Time since the state that was heard of it was sampled [s]."""
    centre: Array
    """Its output point [m], shape (axes,)."""
    corners: Array
    """The least and the largest that it can be [m], shape (2, axes); twice the centre where one
    state is taken for the truth."""
    used: bool
    """Whether the last input of the agent counted on its state."""


class News(NamedTuple):
    """A statement that came to an agent."""

    t: float
    """Time of the agent's sample [s]."""
    peer: int
    said: SentInput | None
    """None: the agent forgot what it knew."""
    relayed: bool = False


class Beliefs:
    """The beliefs of each agent with a radio, at any time, from the news that came to it."""

    def __init__(self, swarm: Swarm) -> None:
        self._swarm, self._ledger = swarm, StatementLedger(swarm)
        self.news = {
            i: [News(0.0, l, said) for l, said in known.items()]
            for i, known in self._ledger.known.items()
        }
        """By agent, in order."""
        self._used = defaultdict[int, list[set[int]]](list)
        self.sampled = defaultdict[int, list[float]](list)
        """By agent, times of its recorded samples [s]."""

    def at(self, i: int, t: float) -> list[Belief]:
        """Return agent i's beliefs at t [s]; none of an agent without a radio."""
        newest = {news.peer: news.said for news in self.news.get(i, ()) if news.t <= t}
        heard = {l: said for l, said in newest.items() if said}
        if not heard:
            return []
        swarm, knowledge = self._swarm, PeerKnowledge(self._swarm, i)
        x, _ = knowledge(np.zeros(swarm.safe_set.parts[-1].stop), (), t, heard)
        boxes, centres = knowledge.boxes(), swarm.positions(x)
        axes, radio = centres.shape[1], swarm.groups[i].radio
        k = int(np.searchsorted(self.sampled[i], t, side="right"))
        used = self._used[i][k - 1] if k else set()
        one = radio is not None and radio.belief != "set"
        return [
            Belief(
                l, age, centres[l],
                np.array([centres[l]] * 2 if one else [end[:axes] for end in boxes[l]]), l in used,
            )
            for l, age in knowledge.age.items()
        ]  # fmt: skip

    def ages(self, i: int) -> dict[int, Series]:
        """Return by peer the age of what agent i knew of it, at each of its samples [s]."""
        t, ages = np.array(self.sampled[i]), {}
        for l in sorted({news.peer for news in self.news.get(i, ())}):
            of_peer = [n for n in self.news[i] if n.peer == l]
            stamps = np.array([n.said.t if n.said else np.nan for n in of_peer])
            newest = np.searchsorted([n.t for n in of_peer], t, side="right") - 1
            ages[l] = Series(t, np.where(newest < 0, np.nan, t - stamps[newest]))
        return ages


class RecordedBeliefs(Beliefs):
    """The same, as they follow from a recording.

    With `time.recording_step`, statements have the states that were recorded last.
    """

    def __init__(self, recording: Recording, swarm: Swarm) -> None:
        super().__init__(swarm)
        self._index = {name: i for i, name in enumerate(swarm.names)}
        self._follow(recording)

    def _follow(self, recording: Recording) -> None:
        fates, times, x = RecordedFates(recording, self._swarm), recording.times, recording.x
        trust, direct = recording.summary and recording.summary.trust, set[tuple[int, int, int]]()
        convictions = trust.convictions if trust else []
        restarts = [
            c for c in recording.commands if c.effect and c.effect.process is ProcessChange.STARTS
        ]
        for step in sorted(recording.steps, key=lambda step: step.t):
            i = self._index[step.agent]
            if i not in self.news:
                continue
            while restarts and restarts[0].t <= step.t:
                self._restart(restarts[0].t, self._index[restarts.pop(0).agent])
            of_step, before = fates.of(step), dict(self._ledger.known[i])
            direct |= {(i, fate.sender, fate.k) for fate in of_step if fate.claim}
            state = x[max(int(np.searchsorted(times, step.t, side="right")) - 1, 0)]
            own_state = state[self._swarm.safe_set.parts[i]].tolist()
            convicted = [
                self._index[c.of] for c in convictions if (c.by, c.t) == (step.agent, step.t)
            ]
            self._ledger.sampled(i, step.t, step.k, own_state, of_step, convicted)
            self.news[i] += [
                News(step.t, l, said, (i, l, said.k) not in direct)
                for l, said in self._ledger.known[i].items()
                if said is not before.get(l)
            ]
            self.sampled[i].append(step.t)
            self._used[i].append({self._index[name] for name, _ in step.ages})

    def _restart(self, t: float, i: int) -> None:
        if i in self.news:
            self.news[i] += [News(t, l, None) for l in self._ledger.known[i]]
            self._ledger.restarted(i)


def braking_values(swarm: Swarm, states: Array) -> tuple[list[str], Array]:
    """Return the names of pairs of peers by radio, and V of each at some states, shape (s, p) [m].

    V = R + 2ρ + L(v_i) + L(v_j) - d, of states: agents keep it below 0 for their references, which
    are within ρ of them. states: stacked, shape (s, n̄).
    """
    parts, function = swarm.safe_set.parts, swarm.safety.safe_set_function
    assert isinstance(function, Distance | Separation), "no other goes with a radio"
    points = {i: agent_point(swarm, i) for i in swarm.normal if swarm.peers(i)}
    names = [swarm.safe_set.label(Pair(*sides)) for sides in combinations(points, 2)]
    motions = stacked([point.motion for point in points.values()])
    p, v = halves(np.array([[of.of(x[parts[i]]) for i, of in points.items()] for x in states]))
    ways = motions.tube + motions.stopping(length(v))
    a, b = np.triu_indices(len(points), 1)
    V: Array = function.radius + ways[:, a] + ways[:, b] - length(p[:, a] - p[:, b])
    return names, V
