"""The certificates of a swarm: compiled once for each kind of pair, evaluated for inputs."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index, Mask
from phalanx.guarantee.certificate import (
    DEFECT,
    MULTIPLES,
    PairCertificate,
    highest_within,
    pair_certificate,
)
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.kept import kept
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.pairs import spread


class Held(NamedTuple):
    """An input that a normal agent holds from now on."""

    agent: "AgentCertificates"
    x: Array
    """The true stacked state now, shape (n̄,)."""
    u: Array
    """shape (m_i,)"""
    near: Array | None = None
    """True for the agent's pairs that may become unsafe within the longest horizon, shape (p,);
    None if that is not known."""


class _Kind(NamedTuple):
    """Functions shared by pairs with the same expressions and bounds."""

    certificate: PairCertificate
    highest: MappedFunction | None
    """(x and the obstacle's numbers) -> upper bound of h within the longest horizon for all inputs
    of all agents; None if there is none. It is cheap."""
    sizes: list[int]
    """Number of variables of each side."""


class SwarmCertificates:
    """The certificates of a swarm's pairs, compiled once for each kind of pair."""

    def __init__(self, swarm: Swarm) -> None:
        self.swarm, self.pairs = swarm, swarm.pairs
        self.ends: Index = swarm.pairs.every
        """Sides of each pair of the safe set: a, and b or N + k for obstacle k; shape (p, 2)."""
        statics = [-1] * len(swarm.safe_set.obstacles)
        number_of: Index = np.array([*swarm.group_numbers, *statics])
        sorts = np.column_stack([number_of[self.ends], self.pairs.kinds_of(self.ends)])
        self.sorts: Index = np.unique(sorts, axis=0, return_inverse=True)[1].ravel()
        """The same number for pairs with the same groups and expressions, shape (p,)."""
        self.kinds: list[_Kind] = []
        """In the order of first use."""
        self._number: dict[tuple[int, int], int] = {}

    def of(self, i: int) -> "AgentCertificates":
        """Return the certificates of normal agent i."""
        return AgentCertificates(self, i)

    def kind(self, pair: int, own: int) -> int:
        """Return the number of a pair's kind, for the agent whose place in it is `own`."""
        key = own, int(self.sorts[pair])
        if key not in self._number:
            self._number[key] = len(self.kinds)
            self.kinds.append(self._compiled(pair, own))
        return self._number[key]

    def proven(self, held: Sequence[Held]) -> list[Array]:
        """Return for each input the times for which its agent's pairs are proven safe [s].

        Inputs at different times are evaluated in one call, since a call has a large overhead.
        """
        numbers = self.pairs.numbers(np.stack([each.x for each in held]))
        rows = _rows(held, numbers.shape[1])
        found = rows.longest.copy()
        for number in np.unique(rows.kinds).tolist():
            kind, which = self.kinds[number], np.flatnonzero(rows.kinds == number)
            places = rows.places[which, : sum(kind.sizes)]
            if kind.highest is not None:
                # Most pairs are too far apart to meet.
                may_meet = ~(kind.highest(numbers.ravel(), places)[:, 0] <= 0.0)
                which, places = which[may_meet], places[may_meet]
            if len(which):
                u = np.stack([held[k].u for k in rows.held[which].tolist()])
                found[which] = kind.certificate.times(numbers.ravel()[places], u)
        times = [np.full(len(each.agent.pairs), each.agent.longest) for each in held]
        begin = 0
        for own, some in zip(times, rows.chosen, strict=True):
            own[some] = found[begin : (begin := begin + len(some))]
        return times

    def may_meet(self, agent: "AgentCertificates", x: Array, near: Mask) -> Mask:
        """Return which of an agent's pairs may be unsafe within its longest horizon, shape (p,).

        It holds for all inputs of all agents. near: pairs to consider; the others are False.
        """
        numbers, found = self.pairs.numbers(x), near.copy()
        for number in np.unique(agent.kinds[near]).tolist():
            kind, which = self.kinds[number], np.flatnonzero(near & (agent.kinds == number))
            if kind.highest is not None:
                places = agent.places[which, : sum(kind.sizes)]
                found[which] = ~(kind.highest(numbers, places)[:, 0] <= 0.0)
        return found

    def _compiled(self, pair: int, own: int) -> _Kind:
        """Compile a pair's kind, or take that of a view of the same swarm."""
        swarm, (a, b) = self.swarm, self.ends[pair].tolist()
        involved = [l for l in (a, b) if l < len(swarm.members)]
        (number,) = self.pairs.kinds_of(self.ends[[pair]]).tolist()
        text = self.pairs.kinds[number].kind.text
        key = "certificate", text, own, *[swarm.group_numbers[l] for l in involved]
        if key not in swarm.compiled:
            bounds = [swarm.disturbance_bounds[swarm.names[l]] + DEFECT for l in involved]
            tau, alphas = swarm.horizon(involved[own]), swarm.safety.class_k
            alone = self.pairs.alone(a, b)

            def compiled() -> _Kind:
                highest = highest_within(alone, bounds, MULTIPLES[0] * tau)
                made = pair_certificate(alone, own, alphas, bounds, tau)
                return _Kind(made, highest, alone.sizes)

            # Another run of this process may have had such a pair.
            bound = _text(alone.members, alphas)
            swarm.compiled[key] = kept((text, bound, own, *bounds, tau), compiled)
        found: _Kind = swarm.compiled[key]
        return found


def _text(members: Sequence[Member], alphas: Sequence[ClassK]) -> str:
    """Serialize what a kind of pair does not have: names, input bounds and class-K functions."""
    symbols = [ca.SX.sym("x", len(m.dynamics.states)) for m in members]
    s = ca.SX.sym("s")
    outputs = [
        *[
            part
            for m, x in zip(members, symbols, strict=True)
            for part in m.dynamics.input_polytope(x)
        ],
        *[alpha.value(s) for alpha in alphas],
    ]
    found: str = ca.Function("bounds", [*symbols, s], outputs).serialize()
    return " ".join([*[m.name for m in members], found])


class _Rows(NamedTuple):
    """The pairs to evaluate, those of one input after those of another."""

    chosen: list[Index]
    """Indices among the agent's pairs, for each input."""
    held: Index
    """Number of the input of each row, shape (r,)."""
    kinds: Index
    """shape (r,)"""
    places: Index
    """Positions of each row's variables, shape (r, n), as in AgentCertificates."""
    longest: Array
    """Upper bound of each result [s], shape (r,)."""


def _rows(held: Sequence[Held], width: int) -> _Rows:
    """width: number of variables of a stacked state and the obstacles."""
    agents = [each.agent for each in held]
    chosen = [
        np.arange(len(agent.pairs)) if near is None else near.nonzero()[0]
        for agent, _, _, near in held
    ]
    each = list(zip(agents, chosen, strict=True))
    numbers = np.repeat(np.arange(len(held)), [len(some) for some in chosen])
    return _Rows(
        chosen,
        numbers,
        np.concatenate([agent.kinds[some] for agent, some in each]),
        np.concatenate([agent.places[some] for agent, some in each]) + numbers[:, None] * width,
        np.array([agent.longest for agent in agents])[numbers],
    )


class AgentCertificates:
    """The certificates of all pairs of normal agent i."""

    def __init__(self, swarm: SwarmCertificates, i: int) -> None:
        self._swarm = swarm
        first, second = swarm.ends.T
        mine = np.flatnonzero((first == i) | (second == i))
        self.pairs = tuple(mine.tolist())
        """Indices of agent i's pairs in the safe set."""
        self.tau = swarm.swarm.horizon(i)
        """τ = Γ_i + δ_i^max and the latency [s]."""
        self.longest = MULTIPLES[0] * self.tau
        """The longest horizon: the result for pairs that stay safe for longer [s]."""
        sides = (swarm.ends[mine, 0] != i).astype(np.intp)
        self.kinds: Index = np.empty(len(mine), dtype=np.intp)
        """Number of each pair's kind, shape (p,)."""
        width = max(sum(kind.kind.sizes) for kind in swarm.pairs.kinds)
        self.places: Index = np.zeros((len(mine), width), dtype=np.intp)
        """Positions of each pair's variables, shape (p, n), padded with zeros."""
        sorts = 2 * swarm.sorts[mine] + sides
        for sort in np.unique(sorts).tolist():
            which = np.flatnonzero(sorts == sort)
            number = swarm.kind(self.pairs[which[0]], sort % 2)
            places = spread(swarm.pairs.begin, swarm.ends[mine[which]], swarm.kinds[number].sizes)
            self.kinds[which] = number
            self.places[which, : places.shape[1]] = places

    @property
    def refused(self) -> dict[int, str]:
        """Reasons, by index, of pairs that no input of the agent can certify."""
        each = [self._swarm.kinds[number].certificate for number in self.kinds.tolist()]
        return {
            pair: certificate.refused
            for pair, certificate in zip(self.pairs, each, strict=True)
            if certificate.proven is None
        }

    def __call__(self, x: Array, u: Array, near: Array | None = None) -> Array:
        """Return the time for which each pair is proven safe with one input [s]."""
        (times,) = self._swarm.proven([Held(self, x, u, near)])
        return times


def certified_for(swarm: Swarm, i: int) -> Callable[[Array, Array, Sequence[int]], float]:
    """Return (stacked state, own input, agents seen) -> time proven safe [s], of normal agent i.

    It is that of the verdict for the pairs in sight. Compiled when it is first called.
    """
    compiled = cache(lambda: swarm.once(SwarmCertificates).of(i))

    def certified(x: Array, u: Array, seen: Sequence[int]) -> float:
        each, known = compiled(), {*seen, *range(len(swarm.members), len(swarm.safe_set.labels))}
        pairs = [swarm.safe_set.pairs[number] for number in each.pairs]
        near = np.array([known.issuperset(pair) for pair in pairs], dtype=np.float64)
        return float(each(x, u, near).min(initial=each.longest))

    return certified


class CertifiedStart(NamedTuple):
    """Certificates at x(0)."""

    safe: bool
    """True if every pair's h <= 0 at x(0)."""
    refused: dict[str, str]
    """Reasons, by label, of pairs that no input can certify."""
    agents: dict[str, bool]
    """By normal agent: True if an input was found at x(0) with which all its pairs are proven safe
    until its next sample."""

    @property
    def holds(self) -> bool:
        """True if certificates can cover every pair from the start of a run."""
        return self.safe and not self.refused and all(self.agents.values())


def certified_start(swarm: Swarm) -> CertifiedStart:
    """Evaluate the certificates of the verdict at x(0)."""
    certificates = swarm.once(SwarmCertificates)
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
    """Return whether zero or a corner of U_i is certified; with a latency, zero alone."""
    clock, latency = swarm.groups[i].clock, swarm.time.latency
    dynamics = swarm.members[i].dynamics
    zero = np.zeros(len(dynamics.inputs))
    possible = [pair not in certificates.refused for pair in certificates.pairs]
    inputs, needed = [zero], latency
    if not latency:
        state = ca.SX.sym("x", len(dynamics.states))
        known = constant_polytope(*dynamics.input_polytope(state))
        inputs += [] if known is None else list(known.corners)
        needed = clock.period - clock.jitter
    return any(bool((certificates(x, u)[possible] >= needed).all()) for u in inputs)
