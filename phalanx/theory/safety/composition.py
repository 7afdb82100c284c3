"""Safe-set functions h of pairs, and their composition h_tot = LSE(h_1, ..., h_p).

Safe is h <= 0. Pairs are normal-normal, normal-adversary and normal-obstacle; collisions among
adversaries do not count (Remark "uncontrollable").
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import casadi as ca

from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.function import Body, Boundary, SafeSetFunction, Static, static_h

FAR = -1e9
"""h of a pair that is left out of a composition: far below any other."""


@dataclass(frozen=True)
class Member:
    """One agent of the swarm: its name, dynamics and side.

    >>> Member("a", SingleIntegrator(speed=1.0), adversary=False).name
    'a'
    """

    name: str
    dynamics: Dynamics
    adversary: bool


class Pair(NamedTuple):
    """Indices of a normal member a, and of another member b, or N + k for obstacle or limit k."""

    a: int
    b: int


@dataclass(frozen=True)
class ComposedSet:
    """The safe set of a swarm as expressions of the stacked state x, each built on first use.

    These grow with the swarm: agents evaluate functions by kinds of pairs instead (rows.composed).
    """

    members: tuple[Member, ...]
    obstacles: tuple[Static, ...]
    """Obstacles, then limits."""
    function: SafeSetFunction
    rho: float | None
    """ρ of LSE; None for one pair alone, whose h is h_tot."""
    parameters: ca.SX = field(default_factory=lambda: ca.SX(0, 1), compare=False)
    """Symbols in place of an obstacle's numbers, shape (k,); usually none."""

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """The slice of x with each member's state."""
        return stacked_slices(self.sizes[:-1])

    @property
    def sizes(self) -> list[int]:
        """Number of states of each member, then number of parameters."""
        return [*[len(m.dynamics.states) for m in self.members], self.parameters.numel()]

    @cached_property
    def x(self) -> ca.SX:
        """Stacked state, shape (n̄,)."""
        return ca.vertcat(*[ca.SX.sym("x", len(m.dynamics.states)) for m in self.members])

    @cached_property
    def positions(self) -> tuple[ca.SX, ...]:
        """Each member's output position [m]."""
        return tuple(body.p for body in self.bodies)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Pairs of normal members with one another, with adversaries and with obstacles."""
        normal = [i for i, m in enumerate(self.members) if not m.adversary]
        adversaries = [j for j, m in enumerate(self.members) if m.adversary]
        pairs = [Pair(i, j) for i in normal for j in normal if i < j]
        pairs += [Pair(i, j) for i in normal for j in adversaries]
        static = range(len(self.members), len(self.members) + len(self.obstacles))
        pairs += [Pair(i, b) for i in normal for b in static]
        return tuple(pairs)

    @cached_property
    def h(self) -> ca.SX:
        """Every pair's h, shape (p,)."""
        sides = [*self.bodies, *self.obstacles]
        return ca.vertcat(*[self._h(self.bodies[a], sides[b]) for a, b in self.pairs])

    def _h(self, a: Body, b: Body | Static) -> ca.SX:
        if isinstance(b, Body):
            return self.function.between(a, b)
        return static_h(self.function, a, b)

    @cached_property
    def h_tot(self) -> ca.SX:
        """LSE of h, scalar; contains the symbol sigma."""
        if self.rho is None:
            return self.h
        return log_sum_exp(self.h, self.rho, self.sigma)

    @cached_property
    def sigma(self) -> ca.SX:
        """LSE's σ as a symbol, which is a constant under differentiation."""
        return ca.SX.sym("sigma")

    def substitute(self, expression: ca.SX) -> ca.SX:
        """Substitute σ = max h, the paper's choice, in an expression of x and σ."""
        return ca.substitute(expression, self.sigma, ca.mmax(self.h))

    def alone(self, pair: int) -> "ComposedSet":
        """One pair as a safe set of its own: its members, in order, and its h as h_tot."""
        chosen = self.pairs[pair]
        return of_pair(self.members[chosen.a], self.other_side(chosen), self.function)

    def other_side(self, pair: Pair) -> Member | Static:
        """The second side of a pair."""
        return [*self.members, *self.obstacles][pair.b]

    def method_of(self, pair: Pair) -> tuple[object, str]:
        """The object that computes h of a pair, and the name of its method."""
        other = self.other_side(pair)
        if isinstance(other, Boundary):
            return other.limit, "alone"
        return self.function, "between" if isinstance(other, Member) else "to_obstacle"

    def label(self, pair: Pair) -> str:
        """A pair as text: "1-4", "1-obstacle 2", or "1-limit 0"."""
        return f"{self.labels[pair.a]}-{self.labels[pair.b]}"

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the members, then "obstacle k" and "limit k", each counted from 0."""
        names = [m.name for m in self.members]
        limits = sum(isinstance(o, Boundary) for o in self.obstacles)
        names += [f"obstacle {k}" for k in range(len(self.obstacles) - limits)]
        return *names, *[f"limit {k}" for k in range(limits)]

    @cached_property
    def bodies(self) -> list[Body]:
        """The members as arguments of safe-set functions."""
        return [
            Body(
                self.x[part],
                m.dynamics.position(self.x[part]),
                tuple(m.dynamics.states),
                m.adversary,
            )
            for m, part in zip(self.members, self.parts, strict=True)
        ]


def stacked_slices(sizes: Sequence[int]) -> tuple[slice, ...]:
    """Consecutive slices of the given lengths."""
    ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]
    return tuple(slice(end - size, end) for size, end in zip(sizes, ends, strict=True))


def log_sum_exp(h: ca.SX, rho: float, sigma: ca.SX) -> ca.SX:
    """LSE(h) = σ + ln(Σ exp(ρ (h - σ))) / ρ: between max h and max h + ln(p)/ρ.

    The value does not depend on σ, so σ is a constant under differentiation. LSE of one h is h.
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

    parameters: symbols in place of the obstacle's numbers.
    """
    symbols = ca.SX(0, 1) if parameters is None else parameters
    if isinstance(b, Member):
        return ComposedSet((a, b), (), function, None, symbols)
    return ComposedSet((a,), (b,), function, None, symbols)
