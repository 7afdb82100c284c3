"""The certificates of a swarm: compiled once for each kind of pair, and asked for inputs."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index
from phalanx.guarantee.certificate import (
    DEFECT,
    MULTIPLES,
    PairCertificate,
    highest_within,
    pair_certificate,
)
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.pairs import spread


class Held(NamedTuple):
    """An input that a normal agent holds from now on."""

    agent: "AgentCertificates"
    x: Array
    """The true stacked state now, shape (n̄,)."""
    u: Array
    """shape (m_i,)"""
    near: Array | None = None
    """Which of the agent's pairs may become unsafe within the longest horizon at all, shape (p,);
    None if that is not known."""


class _Kind(NamedTuple):
    """What pairs with the same expressions and bounds have in common."""

    certificate: PairCertificate
    highest: MappedFunction | None
    """(x and the obstacle's numbers) -> the highest that h can be within the longest horizon,
    whatever all agents do, agent i too; None if unknown. It has few operations."""
    sizes: list[int]
    """How many numbers each side has."""


class SwarmCertificates:
    """The certificates of a swarm's pairs, compiled once for each kind of pair."""

    def __init__(self, swarm: Swarm) -> None:
        scenario = swarm.scenario
        self.swarm, self.pairs = swarm, swarm.pairs
        self.ends: Index = swarm.pairs.every
        """Of each pair of the composed set: a, and b or N + k for obstacle k; shape (p, 2)."""
        groups = {id(group): number for number, group in enumerate(scenario.agents)}
        own = [groups[id(group)] for group in swarm.groups]
        number_of: Index = np.array([*own, *[-1 for _ in scenario.static]])
        sorts = np.column_stack([number_of[self.ends], self.pairs.kinds_of(self.ends)])
        self.alike: Index = np.unique(sorts, axis=0, return_inverse=True)[1].ravel()
        """The same number for pairs whose groups and expressions are the same, shape (p,)."""
        self.kinds: list[_Kind] = []
        """In the order in which they were first needed."""
        self._number: dict[tuple[int, int], int] = {}

    def of(self, i: int) -> "AgentCertificates":
        """Those of normal agent i."""
        return AgentCertificates(self, i)

    def kind(self, pair: int, own: int) -> int:
        """The number of the kind of a pair, for the agent whose place in it is `own`."""
        key = own, int(self.alike[pair])
        if key not in self._number:
            self._number[key] = len(self.kinds)
            self.kinds.append(self._compiled(pair, own))
        return self._number[key]

    def proven(self, held: Sequence[Held]) -> list[Array]:
        """How long each pair's h <= 0 is proven from now on [s], in the order of its agent's pairs.

        Of several inputs, each with its own now: a call costs more than what it says of one.
        """
        numbers = self.pairs.numbers(np.stack([each.x for each in held]))
        rows = _rows(held, numbers.shape[1])
        found = rows.longest.copy()
        for number in np.unique(rows.kinds).tolist():
            kind, which = self.kinds[number], np.flatnonzero(rows.kinds == number)
            places = rows.places[which, : sum(kind.sizes)]
            if kind.highest is not None:
                # Most of them are too far apart to meet.
                may_meet = ~(kind.highest(numbers.ravel(), places)[:, 0] <= 0.0)
                which, places = which[may_meet], places[may_meet]
            if len(which):
                u = np.stack([held[k].u for k in rows.held[which].tolist()])
                found[which] = kind.certificate.times(numbers.ravel()[places], u)
        times = [np.full(len(each.agent.pairs), each.agent.longest) for each in held]
        for own, some, of_some in zip(times, rows.asked, np.split(found, rows.ends), strict=True):
            own[some] = of_some
        return times

    def _compiled(self, pair: int, own: int) -> _Kind:
        swarm, (a, b) = self.swarm, self.ends[pair].tolist()
        involved = [l for l in (a, b) if l < len(swarm.members)]
        bounds = [swarm.disturbance_bounds[swarm.names[l]] + DEFECT for l in involved]
        tau, alphas = swarm.horizon(involved[own]), swarm.safety.class_k
        alone = self.pairs.alone(a, b)
        highest = highest_within(alone, bounds, MULTIPLES[0] * tau)
        return _Kind(pair_certificate(alone, own, alphas, bounds, tau), highest, alone.sizes)


class _Rows(NamedTuple):
    """All pairs of which something is asked, one after the other."""

    asked: list[Index]
    """Which they are among their agent's pairs, for each input."""
    held: Index
    """Number of the input that each is asked for, shape (r,)."""
    kinds: Index
    """shape (r,)"""
    places: Index
    """Where each one's numbers lie, shape (r, n), as AgentCertificates has them."""
    longest: Array
    """The most that is said of each [s], shape (r,)."""

    @property
    def ends(self) -> Index:
        """Where those of an input end, but for the last."""
        return np.cumsum([len(some) for some in self.asked[:-1]], dtype=np.intp)


def _rows(held: Sequence[Held], width: int) -> _Rows:
    """width: how many numbers a state and the obstacles have."""
    agents = [each.agent for each in held]
    asked = [
        np.arange(len(agent.pairs)) if near is None else np.flatnonzero(near)
        for agent, _, _, near in held
    ]
    each = list(zip(agents, asked, strict=True))
    numbers = np.repeat(np.arange(len(held)), [len(some) for some in asked])
    return _Rows(
        asked,
        numbers,
        np.concatenate([agent.kinds[some] for agent, some in each]),
        np.concatenate([agent.places[some] for agent, some in each]) + numbers[:, None] * width,
        np.array([agent.longest for agent in agents])[numbers],
    )


class AgentCertificates:
    """Of all pairs of normal agent i."""

    def __init__(self, swarm: SwarmCertificates, i: int) -> None:
        self._swarm = swarm
        first, second = swarm.ends.T
        mine = np.flatnonzero((first == i) | (second == i))
        self.pairs = tuple(mine.tolist())
        """Indices of agent i's pairs in the composed set."""
        self.tau = swarm.swarm.horizon(i)
        """τ = Γ_i + δ_i^max and the latency [s]."""
        self.longest = MULTIPLES[0] * self.tau
        """What is said of a pair that cannot become unsafe for longer [s]."""
        sides = (swarm.ends[mine, 0] != i).astype(np.intp)
        self.kinds: Index = np.empty(len(mine), dtype=np.intp)
        """Of each pair, by number, shape (p,)."""
        width = max(sum(kind.kind.sizes) for kind in swarm.pairs.kinds)
        self.places: Index = np.zeros((len(mine), width), dtype=np.intp)
        """Where each pair's numbers lie, shape (p, n), zeros after those that it has."""
        differ = 2 * swarm.alike[mine] + sides
        for alike in np.unique(differ).tolist():
            which = np.flatnonzero(differ == alike)
            number = swarm.kind(self.pairs[which[0]], alike % 2)
            places = spread(swarm.pairs.begin, swarm.ends[mine[which]], swarm.kinds[number].sizes)
            self.kinds[which] = number
            self.places[which, : places.shape[1]] = places

    @property
    def refused(self) -> dict[int, str]:
        """Pairs that no input of the agent's can ever certify, by index, and why."""
        each = [self._swarm.kinds[number].certificate for number in self.kinds.tolist()]
        return {
            pair: certificate.refused
            for pair, certificate in zip(self.pairs, each, strict=True)
            if certificate.proven is None
        }

    def __call__(self, x: Array, u: Array, near: Array | None = None) -> Array:
        """How long each pair is proven safe with one input, as SwarmCertificates.proven has it."""
        (times,) = self._swarm.proven([Held(self, x, u, near)])
        return times


class CertifiedStart(NamedTuple):
    """What certificates can say of a scenario before any run."""

    safe: bool
    """Whether every pair's h <= 0 at x(0)."""
    refused: dict[str, str]
    """Pairs that can never be certified, by label, and why."""
    agents: dict[str, bool]
    """By normal agent: whether some input was found at x(0) with which all its pairs are proven
    safe until its next sample may come."""

    @property
    def holds(self) -> bool:
        """Whether a run can begin under certificates."""
        return self.safe and not self.refused and all(self.agents.values())


def certified_start(swarm: Swarm) -> CertifiedStart:
    """Ask the certificates that a run is judged by, at x(0)."""
    certificates = SwarmCertificates(swarm)
    agents = {i: certificates.of(i) for i in swarm.normal}
    composed, x = swarm.safe_set, swarm.start()
    refused = {}
    for number, pair in enumerate(composed.pairs):
        sides = [agents[l].refused for l in (pair.a, pair.b) if l in agents]
        if all(number in side for side in sides):
            refused[composed.label(pair)] = sides[0][number]
    begun = {swarm.names[i]: _begins(swarm, i, each, x) for i, each in agents.items()}
    h = swarm.pairs.choose(swarm.pairs.every).h(x)
    return CertifiedStart(bool((h <= 0.0).all()), refused, begun)


def _begins(swarm: Swarm, i: int, certificates: AgentCertificates, x: Array) -> bool:
    """Whether zero, or a corner of U_i, is certified: zero alone until a latency is over."""
    clock, latency = swarm.groups[i].clock, swarm.time.latency
    dynamics = swarm.members[i].dynamics
    zero = np.zeros(len(dynamics.inputs))
    asked = [pair not in certificates.refused for pair in certificates.pairs]
    inputs, needed = [zero], latency
    if not latency:
        state = ca.SX.sym("x", len(dynamics.states))
        known = constant_polytope(*dynamics.input_polytope(state))
        inputs += [] if known is None else list(known.corners)
        needed = clock.period - clock.jitter
    return any(bool((certificates(x, u)[asked] >= needed).all()) for u in inputs)
