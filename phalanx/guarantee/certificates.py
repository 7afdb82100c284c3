"""The certificates of a swarm: compiled once for each kind of pair, and asked agent by agent."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.certificate import (
    MULTIPLES,
    PairCertificate,
    highest_within,
    pair_certificate,
)
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.mapped import Index, MappedFunction
from phalanx.theory.safety.pairs import spread

Array = NDArray[np.float64]


class _Kind(NamedTuple):
    """What pairs with the same expressions and bounds have in common."""

    certificate: PairCertificate
    highest: MappedFunction | None
    """(x and the obstacle's numbers) -> the highest that h can be within the longest horizon,
    whatever all agents do, agent i too; None if unknown. It has few operations."""


class SwarmCertificates:
    """The certificates of a swarm's pairs, compiled once for each kind of pair."""

    def __init__(self, swarm: Swarm) -> None:
        scenario, composed = swarm.scenario, swarm.safe_set
        self.swarm, self.pairs = swarm, swarm.pairs
        members = len(swarm.members)
        ends = [(p.a, members + (p.obstacle or 0) if p.b is None else p.b) for p in composed.pairs]
        self.ends: Index = np.array(ends)
        """Of each pair of the composed set: a, and b or N + k for obstacle k; shape (p, 2)."""
        groups = {id(group): number for number, group in enumerate(scenario.agents)}
        own = [groups[id(group)] for group in swarm.groups]
        number_of: Index = np.array([*own, *[-1 for _ in scenario.static]])
        self.alike: Index = np.column_stack([number_of[self.ends], self.pairs.kinds_of(self.ends)])
        """What makes pairs alike: the groups of both, and the expressions; shape (p, 3)."""
        self._kinds: dict[tuple[int, ...], _Kind] = {}

    def of(self, i: int) -> "AgentCertificates":
        """Those of normal agent i."""
        return AgentCertificates(self, i)

    def kind(self, pair: int, own: int) -> _Kind:
        """What pairs like this one have in common, for the agent whose place in them is `own`."""
        key = (own, *self.alike[pair].tolist())
        if key not in self._kinds:
            self._kinds[key] = self._compiled(pair, own)
        return self._kinds[key]

    def _compiled(self, pair: int, own: int) -> _Kind:
        swarm, (a, b) = self.swarm, self.ends[pair].tolist()
        involved = [l for l in (a, b) if l < len(swarm.members)]
        bounds = [swarm.disturbance_bounds[swarm.names[l]] for l in involved]
        tau, alphas = swarm.horizon(involved[own]), swarm.scenario.safety.class_k()
        alone = self.pairs.alone(a, b)
        highest = highest_within(alone, bounds, MULTIPLES[0] * tau)
        return _Kind(pair_certificate(alone, own, alphas, bounds, tau), highest)


class _Alike(NamedTuple):
    """Pairs of agent i's of one kind."""

    kind: _Kind
    which: Index
    """Their places among agent i's pairs."""
    places: Index
    """Where their numbers lie, shape (r, n)."""


class AgentCertificates:
    """Of all pairs of normal agent i."""

    def __init__(self, swarm: SwarmCertificates, i: int) -> None:
        self._numbers = swarm.pairs.numbers
        first, second = swarm.ends.T
        mine = np.flatnonzero((first == i) | (second == i))
        self.pairs = tuple(mine.tolist())
        """Indices of agent i's pairs in the composed set."""
        self.tau = swarm.swarm.horizon(i)
        """τ = Γ_i + δ_i^max and the latency [s]."""
        self._longest = MULTIPLES[0] * self.tau
        sides = (swarm.ends[mine, 0] != i).astype(np.intp)
        differ = np.column_stack([sides, swarm.alike[mine]])
        self._alike = []
        for alike in np.unique(differ, axis=0):
            which = np.flatnonzero((differ == alike).all(axis=1))
            kind = swarm.kind(self.pairs[which[0]], int(alike[0]))
            ends = swarm.ends[mine[which]]
            places = spread(swarm.pairs.begin, ends, swarm.pairs.kinds[alike[-1]].kind.sizes)
            self._alike.append(_Alike(kind, which, places))

    @property
    def refused(self) -> dict[int, str]:
        """Pairs that no input of the agent's can ever certify, by index, and why."""
        return {
            self.pairs[k]: alike.kind.certificate.refused
            for alike in self._alike
            if alike.kind.certificate.proven is None
            for k in alike.which.tolist()
        }

    def __call__(self, x: Array, u: Array, near: Array | None = None) -> Array:
        """How long each pair's h <= 0 is proven from now on [s], in the order of `pairs`.

        Args:
            x: the true stacked state, shape (n̄,).
            u: the input that agent i holds from now on, shape (m_i,).
            near: which pairs may become unsafe within the longest horizon at all, shape (p,);
                None if that is not known.
        """
        numbers, times = self._numbers(x), np.full(len(self.pairs), self._longest)
        for (certificate, highest), which, places in self._alike:
            some = np.arange(len(which)) if near is None else np.flatnonzero(near[which])
            if highest is not None and len(some):
                # Most of them are too far apart to meet.
                some = some[~(highest(numbers, places[some])[:, 0] <= 0.0)]
            if len(some):
                times[which[some]] = certificate.times(numbers[places[some]], u)
        return times
