"""The certificates of a swarm: compiled once for each kind of pair, evaluated for inputs."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.certificate import (
    MULTIPLES,
    PairCertificate,
    highest_within,
    least_now,
    pair_certificate,
)
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.cache import cached
from phalanx.theory.expressions.compiled import MappedFunction, MappedRows
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.pairs import spread

QUIET = 2.0
"""Longest horizons for which pairs far apart are not looked at again."""
_MOST_CHOSEN = 16
"""Sets of an agent's pairs that are kept, grouped by kind."""


class _Kind(NamedTuple):
    """Functions shared by pairs with the same expressions and bounds."""

    certificate: PairCertificate
    highest: MappedFunction
    """(x and the obstacle's numbers) -> upper bounds of h within the longest horizon, and within
    QUIET of them, for all inputs of all agents. It is cheap."""
    least: MappedFunction
    """(x and the obstacle's numbers) -> lower bound of h now. It is cheaper still."""
    sizes: list[int]
    """Number of variables of each side."""
    inputs: int
    """m_i of the agent."""

    @property
    def longest(self) -> float:
        """The longest horizon: the result for pairs that stay safe for longer [s]."""
        return self.certificate.horizons[0]


class SwarmCertificates:
    """The certificates of a swarm's pairs, compiled once for each kind of pair."""

    def __init__(self, swarm: Swarm) -> None:
        self.swarm, self.pairs = swarm, swarm.pairs
        self.ends: Index = swarm.pairs.every
        """Sides of each pair of the safe set: a, and b or N + k for obstacle k; shape (p, 2)."""
        self.kinds: list[_Kind] = []
        """In the order of first use."""
        self._number: dict[tuple[int, int], int] = {}
        width = max(sum(kind.pair.sizes) for kind in swarm.pairs.kinds)
        # Rows that no agent has filled take no memory.
        self._kind_of = np.zeros(2 * len(self.ends), dtype=np.intp)
        """Number of the kind of each side of each pair, 2 pair + side; shape (2 p,)."""
        self._variables = np.zeros((2 * len(self.ends), width), dtype=np.intp)
        """Indices of their variables, padded with zeros, shape (2 p, n)."""

    def of(self, i: int) -> "AgentCertificates":
        """Return the certificates of normal agent i."""
        return AgentCertificates(self, i)

    def bounds(self, pair: ComposedSet) -> list[float]:
        """Return φ^max of each member of a pair, and the integration's defect."""
        return [self.swarm.disturbance_bounds[m.name] + DEFECT for m in pair.members]

    def kind(self, pair: int, side: int) -> int:
        """Return the number of a pair's kind, for the agent on one side of it, 0 or 1."""
        key = side, int(self.swarm.pair_sorts[pair])
        if key not in self._number:
            self._number[key] = len(self.kinds)
            self.kinds.append(self._compiled(pair, side))
        return self._number[key]

    def add(self, sides: Index, kind: int, variables: Index) -> None:
        """Enter sides of one kind, shape (r,), with the indices of their variables, (r, n)."""
        self._kind_of[sides], self._variables[sides, : variables.shape[1]] = kind, variables

    def proven(self, sides: Index, inputs: Index, x: Array, u: Array) -> Array:
        """Return for how long pairs are proven safe while inputs are held [s], shape (q,).

        All in one call, since a call has a large overhead.

        Args:
            sides: of the pairs, 2 pair + side of the agent that holds the input, shape (q,).
            inputs: the row of each in x and u, shape (q,).
            x: true stacked states, shape (r, n̄).
            u: inputs that are held from then on, padded, shape (r, m).
        """
        numbers = self.pairs.numbers(x)
        values, width = numbers.ravel(), numbers.shape[1]
        kinds, times = self._kind_of[sides], np.empty(len(sides))
        for number in np.unique(kinds).tolist():
            kind, rows = self.kinds[number], np.flatnonzero(kinds == number)
            times[rows] = kind.longest
            indices = self._variables[sides[rows], : sum(kind.sizes)]
            indices += inputs[rows, None] * width
            # Most pairs are too far apart to meet.
            may_meet = ~(kind.highest(values, indices)[:, 0] <= 0.0)
            rows, indices = rows[may_meet], indices[may_meet]
            if len(rows):
                # Of an unsafe pair nothing can be proven.
                safe = ~(kind.least(values, indices)[:, 0] > 0.0)
                times[rows] = 0.0
                rows, held = rows[safe], u[inputs[rows[safe]], : kind.inputs]
                times[rows] = kind.certificate.times(values[indices[safe]], held)
        return times

    def _compiled(self, pair: int, side: int) -> _Kind:
        """Compile a pair's kind, or take that of a view of the same swarm."""
        swarm, (a, b) = self.swarm, self.ends[pair].tolist()
        involved = [l for l in (a, b) if l < len(swarm.members)]
        alone, alphas = self.pairs.alone(a, b), swarm.safety.class_k
        text = self.pairs.kind_of(a, b).text
        key = "certificate", text, side, *[swarm.group_numbers[l] for l in involved]
        bounds, tau = self.bounds(alone), swarm.horizon(involved[side])

        def compiled() -> _Kind:
            longest = MULTIPLES[0] * tau
            highest = [highest_within(alone, bounds, t) for t in (longest, QUIET * longest)]
            certificate = pair_certificate(alone, side, alphas, bounds, tau)
            above, below = (
                MappedFunction([alone.x, alone.parameters], results)
                for results in (highest, [least_now(alone)])
            )
            inputs = len(alone.members[side].dynamics.inputs)
            return _Kind(certificate, above, below, alone.sizes, inputs)

        def of_process() -> _Kind:
            # Another run of this process may have had such a pair.
            return cached((text, _limits_text(alone, alphas), side, *bounds, tau), compiled)

        return swarm.functions.get(key, of_process)


def _limits_text(pair: ComposedSet, alphas: Sequence[ClassK]) -> str:
    """Serialize what a kind of pair does not have: names, input bounds and class-K functions."""
    s, outputs = ca.SX.sym("s"), list[ca.SX]()
    for member, part in zip(pair.members, pair.parts, strict=True):
        outputs += member.dynamics.input_polytope(pair.x[part])
    outputs += [alpha.value(s) for alpha in alphas]
    limits: str = ca.Function("bounds", [pair.x, s], outputs).serialize()
    return " ".join([*[m.name for m in pair.members], limits])


class Near(NamedTuple):
    """Pairs of an agent that may become unsafe within its longest horizon."""

    pairs: Mask
    """shape (p,)"""
    unsafe: Mask
    """Those with h > 0 now: nothing is proven of them for any input, shape (p,)."""


class _Group(NamedTuple):
    """An agent's pairs of one kind."""

    kind: _Kind
    pairs: Index
    """Their indices among the agent's pairs, shape (r,)."""
    variables: Index
    """Indices of their variables, shape (r, n)."""


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
        self.sides: Index = (swarm.ends[mine, 0] != i).astype(np.intp)
        """Agent i's side of each pair, 0 or 1, shape (p,)."""
        self.every_side: Index = 2 * mine + self.sides
        """Their numbers among the sides of all pairs, shape (p,)."""
        self.others: Index = swarm.ends[mine, 1 - self.sides]
        """The other member of each pair, or N + k for obstacle k; shape (p,)."""
        self.kinds: Index = np.empty(len(mine), dtype=np.intp)
        """Number of each pair's kind, shape (p,)."""
        self.provable: Mask = np.zeros(len(mine), dtype=bool)
        """Pairs that some input can certify, shape (p,)."""
        self._groups: list[_Group] = []
        self._chosen: dict[bytes, list[tuple[_Group, MappedRows]]] = {}
        """Pairs that `near` was asked for lately, by kind: mostly the same few sets."""
        sorts = 2 * swarm.swarm.pair_sorts[mine] + self.sides
        for sort in np.unique(sorts).tolist():
            pairs = np.flatnonzero(sorts == sort)
            number = swarm.kind(self.pairs[pairs[0]], sort % 2)
            kind = swarm.kinds[number]
            indices = spread(swarm.pairs.begin, swarm.ends[mine[pairs]], kind.sizes)
            self._groups.append(_Group(kind, pairs, indices))
            self.kinds[pairs] = number
            swarm.add(self.every_side[pairs], number, indices)
            self.provable[pairs] = kind.certificate.proven is not None

    @property
    def refused(self) -> dict[int, str]:
        """Reasons, by index, of pairs that no input of the agent can certify."""
        kinds = [self._swarm.kinds[number] for number in self.kinds.tolist()]
        return {
            pair: kind.certificate.refused
            for pair, kind in zip(self.pairs, kinds, strict=True)
            if kind.certificate.proven is None
        }

    def near(self, x: Array, pairs: Mask) -> Near | None:
        """Return which of these pairs may become unsafe within the longest horizon.

        None if none of them may within QUIET such horizons. Both hold for all inputs of all agents.
        pairs: shape (p,).
        """
        if (key := pairs.tobytes()) not in self._chosen:
            if len(self._chosen) == _MOST_CHOSEN:
                self._chosen.clear()
            self._chosen[key] = self._choose(pairs)
        numbers, near = self._swarm.pairs.numbers(x), None
        for (kind, rows, indices), highest in self._chosen[key]:
            highest(numbers)
            if highest.results.max() <= 0.0:
                continue
            near = near or Near(*np.zeros((2, len(pairs)), dtype=bool))
            meet = ~(highest.results[:, 0] <= 0.0)
            if meet.any():
                near.pairs[rows[meet]] = True
                near.unsafe[rows[meet]] = kind.least(numbers, indices[meet])[:, 0] > 0.0
        return near

    def _choose(self, pairs: Mask) -> list[tuple[_Group, MappedRows]]:
        masks = [(group, pairs[group.pairs]) for group in self._groups]
        groups = [_Group(g.kind, g.pairs[m], g.variables[m]) for g, m in masks if m.any()]
        return [(group, group.kind.highest.at(group.variables)) for group in groups]

    def times(self, x: Array, inputs: Sequence[Array], near: Near) -> Array:
        """Return for each input the times for which pairs are proven safe [s], shape (k, p).

        Args:
            x: shape (n̄,).
            inputs: k inputs of shape (m_i,).
            near: at x; all other pairs are safe for the longest horizon.
        """
        numbers = self._swarm.pairs.numbers(x)
        times = np.full((len(inputs), len(near.pairs)), self.longest)
        times[:, near.unsafe] = 0.0
        unknown = near.pairs & ~near.unsafe
        for kind, rows, indices in self._groups:
            if (mask := unknown[rows]).any():
                pairs = numbers[indices[mask]]
                states, u = np.tile(pairs, (len(inputs), 1)), np.repeat(inputs, len(pairs), axis=0)
                proven = kind.certificate.times(states, u)
                times[:, rows[mask]] = proven.reshape(len(inputs), -1)
        return times

    def __call__(self, x: Array, u: Array, near: Mask | None = None) -> Array:
        """Return the time for which each pair is proven safe with one input [s], shape (p,).

        near: the pairs that may become unsafe within the longest horizon, None if not known.
        """
        looked_at = np.full(len(self.pairs), True) if near is None else near
        times = np.full(len(self.pairs), self.longest)
        sides = self.every_side[looked_at]
        none = np.zeros(len(sides), dtype=np.intp)
        times[looked_at] = self._swarm.proven(sides, none, x[None], u[None])
        return times


def certified_for(swarm: Swarm, i: int) -> Callable[[Array, Array, Sequence[int]], float]:
    """Return (stacked state, input, agents in sight) -> time proven safe [s], of normal agent i.

    It is that of the verdict for the pairs in sight. Compiled when it is first called.
    """
    compiled = cache(lambda: SwarmCertificates(swarm).of(i))

    def certified(x: Array, u: Array, visible: Sequence[int]) -> float:
        certificates = compiled()
        others = certificates.others
        in_sight = np.isin(others, visible) | (others >= len(swarm.members))
        return float(certificates(x, u, in_sight).min(initial=certificates.longest))

    return certified
