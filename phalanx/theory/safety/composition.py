"""Safe-set functions h of pairs, and their composition h_tot = LSE(h_1, ..., h_p).

Safe is h <= 0. Pairs are normal-normal, normal-adversary and normal-obstacle; adversaries'
own collisions are nobody's safety (Remark "uncontrollable").
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import casadi as ca
from annotated_types import Gt

from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.function import Body, SafeSetFunction
from phalanx.theory.safety.limits import Boundary, Static, static_h

Positive = Annotated[float, Gt(0)]

FAR = -1e9
"""h of a pair that is left out of a composition: safe beyond doubt."""


@dataclass(frozen=True)
class Member:
    """One agent of the swarm: its name, dynamics and side."""

    name: str
    dynamics: Dynamics
    adversary: bool


@dataclass(frozen=True)
class Pair:
    """Who keeps apart from whom: indices into the members, or of an obstacle or a limit."""

    a: int
    b: int | None
    obstacle: int | None = None


@dataclass(frozen=True)
class ComposedSet:
    """The safe set of a swarm as expressions of the stacked state x, each made when asked for.

    What an agent evaluates is made of pairs (rows.composed), since these grow with the swarm.
    """

    members: tuple[Member, ...]
    obstacles: tuple[Static, ...]
    """What stands still: obstacles, then limits."""
    function: SafeSetFunction
    rho: float | None
    """ρ of LSE; None for one pair alone, whose h is h_tot."""
    parameters: ca.SX = field(default_factory=lambda: ca.SX(0, 1), compare=False)
    """Symbols that an obstacle is made of, shape (k,); usually none."""

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Where each member's state lies in x."""
        return stacked_slices(self.sizes[:-1])

    @property
    def sizes(self) -> list[int]:
        """How many numbers each member has, its states; and the parameters."""
        return [*[len(m.dynamics.states) for m in self.members], self.parameters.numel()]

    @cached_property
    def x(self) -> ca.SX:
        """Stacked state, shape (n̄,)."""
        return ca.vertcat(*[ca.SX.sym("x", len(m.dynamics.states)) for m in self.members])

    @cached_property
    def positions(self) -> tuple[ca.SX, ...]:
        """Each member's output position [m]."""
        return tuple(body.p for body in self._bodies)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Those of normal members, with one another, with adversaries and with obstacles."""
        normal = [i for i, m in enumerate(self.members) if not m.adversary]
        adversaries = [j for j, m in enumerate(self.members) if m.adversary]
        pairs = [Pair(i, j) for i in normal for j in normal if i < j]
        pairs += [Pair(i, j) for i in normal for j in adversaries]
        pairs += [Pair(i, None, k) for i in normal for k in range(len(self.obstacles))]
        return tuple(pairs)

    @cached_property
    def h(self) -> ca.SX:
        """Every pair's h, shape (p,)."""
        bodies, function = self._bodies, self.function
        each = [
            static_h(function, bodies[p.a], self.obstacles[p.obstacle], self.parameters)
            if p.obstacle is not None
            else function.between(bodies[p.a], bodies[p.b or 0])
            for p in self.pairs
        ]
        return ca.vertcat(*each)

    @cached_property
    def h_tot(self) -> ca.SX:
        """LSE of h over the active pairs, scalar; contains sigma and active."""
        if self.rho is None:
            return self.h
        return log_sum_exp(_only(self.h, self.active), self.rho, self.sigma)

    @cached_property
    def sigma(self) -> ca.SX:
        """LSE's σ, a symbol while one differentiates."""
        return ca.SX.sym("sigma")

    @cached_property
    def active(self) -> ca.SX:
        """1 for a pair that h_tot composes, else 0, shape (p,); a symbol likewise."""
        return ca.SX.sym("active", len(self.pairs))

    def substitute(self, expression: ca.SX, active: ca.SX | None = None) -> ca.SX:
        """Put σ = max h, as the paper chooses it, and the active pairs into an expression.

        Args:
            expression: of x, σ and active.
            active: shape (p,), of x, 0 or 1; None for all pairs.
        """
        chosen = ca.SX.ones(len(self.pairs)) if active is None else active
        (settled,) = ca.substitute(
            [expression], [self.sigma, self.active], [_largest_active(self.h, chosen), chosen]
        )
        return settled

    def alone(self, pair: int) -> "ComposedSet":
        """One pair as a safe set of its own: its members, in order, and its h as h_tot."""
        chosen = self.pairs[pair]
        a = self.members[chosen.a]
        if chosen.obstacle is not None:
            return of_pair(a, self.obstacles[chosen.obstacle], self.function)
        return of_pair(a, self.members[chosen.b or 0], self.function)

    def within(self, i: int, radius: float) -> ca.SX:
        """1 for pairs whose both sides lie within `radius` [m] of agent i, shape (p,)."""
        near = [ca.norm_2(p - self.positions[i]) <= radius for p in self.positions]
        near[i] = ca.SX(1)
        hit = [o.distance(self.positions[i]) <= radius for o in self.obstacles]
        return ca.vertcat(*[near[p.a] * _other(p, near, hit) for p in self.pairs])

    def asked(self, pair: Pair) -> tuple[object, str]:
        """Who says h of a pair, and by which method."""
        if pair.obstacle is None:
            return self.function, "between"
        static = self.obstacles[pair.obstacle]
        if isinstance(static, Boundary):
            return static.limit, "alone"
        return self.function, "to_obstacle"

    def label(self, pair: Pair) -> str:
        """A pair in words: "1-4", "1-obstacle 2", or "1-limit 0"."""
        if pair.b is not None:
            other = self.members[pair.b].name
        else:
            other = static_label(self.obstacles, pair.obstacle or 0)
        return f"{self.members[pair.a].name}-{other}"

    @cached_property
    def _bodies(self) -> list[Body]:
        return [
            Body(
                self.x[part],
                m.dynamics.position(self.x[part]),
                tuple(m.dynamics.states),
                m.adversary,
            )
            for m, part in zip(self.members, self.parts, strict=True)
        ]


def static_label(static: Sequence[Static], index: int) -> str:
    """An obstacle or a limit in words, each counted from 0; limits come after obstacles."""
    if isinstance(static[index], Boundary):
        return f"limit {sum(isinstance(one, Boundary) for one in static[:index])}"
    return f"obstacle {index}"


def stacked_slices(sizes: Sequence[int]) -> tuple[slice, ...]:
    """Consecutive slices of the given lengths."""
    ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]
    return tuple(slice(end - size, end) for size, end in zip(sizes, ends, strict=True))


def log_sum_exp(h: ca.SX, rho: float, sigma: ca.SX) -> ca.SX:
    """LSE(h) = σ + ln(Σ exp(ρ (h - σ))) / ρ: between max h and max h + ln(p)/ρ.

    The value does not depend on σ, so σ is a constant under differentiation. Of one h it is h.
    """
    if h.numel() == 1:
        return h
    return sigma + ca.log(ca.sum1(ca.exp(rho * (h - sigma)))) / rho


def compose(
    members: Sequence[Member],
    obstacles: Sequence[Static],
    function: SafeSetFunction,
    rho: float,
) -> ComposedSet:
    """The safe set of a whole swarm: every pair that involves a normal agent, joined by LSE.

    Raises ValueError if there is no normal agent, or no pair at all.
    """
    if all(m.adversary for m in members):
        raise ValueError("expected at least one normal agent, got none")
    if len(members) == 1 and not obstacles:
        raise ValueError("expected a second agent, an obstacle or a limit, got one agent alone")
    return ComposedSet(tuple(members), tuple(obstacles), function, rho)


def of_pair(
    a: Member, b: Member | Static, function: SafeSetFunction, parameters: ca.SX | None = None
) -> ComposedSet:
    """The safe set of one normal member and another member, an obstacle or a limit.

    parameters: symbols that the obstacle is made of.
    """
    symbols = ca.SX(0, 1) if parameters is None else parameters
    if isinstance(b, Member):
        return ComposedSet((a, b), (), function, None, symbols)
    return ComposedSet((a,), (b,), function, None, symbols)


def _only(h: ca.SX, active: ca.SX) -> ca.SX:
    """h of active pairs; FAR, which has no gradient, of the others."""
    return active * h + (1 - active) * FAR


def _largest_active(h: ca.SX, active: ca.SX) -> ca.SX:
    return ca.mmax(_only(h, active))


def _other(pair: Pair, members: Sequence[ca.SX], obstacles: Sequence[ca.SX]) -> ca.SX:
    if pair.b is not None:
        return members[pair.b]
    assert pair.obstacle is not None
    return obstacles[pair.obstacle]
