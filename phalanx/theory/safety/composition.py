"""Safe-set functions h of pairs, and their composition h_tot = LSE(h_1, ..., h_p).

Safe is h <= 0. Pairs are normal-normal, normal-adversary and normal-obstacle; adversaries'
own collisions are nobody's safety (Remark "uncontrollable").
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Gt

from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.function import Body, SafeSetFunction
from phalanx.theory.safety.obstacles import Obstacle

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
    """Who keeps apart from whom: indices into the members, or an obstacle's index."""

    a: int
    b: int | None
    obstacle: int | None = None


@dataclass(frozen=True)
class ComposedSet:
    """The safe set of a swarm as expressions of the stacked state x."""

    members: tuple[Member, ...]
    x: ca.SX
    """Stacked state, shape (n̄,)."""
    parts: tuple[slice, ...]
    """Where each member's state lies in x."""
    positions: tuple[ca.SX, ...]
    """Each member's output position [m]."""
    obstacles: tuple[Obstacle, ...]
    pairs: tuple[Pair, ...]
    h: ca.SX
    """Every pair's h, shape (p,)."""
    h_tot: ca.SX
    """LSE of h over the active pairs, scalar; contains sigma and active."""
    sigma: ca.SX
    """LSE's σ, a symbol while one differentiates."""
    active: ca.SX
    """1 for a pair that h_tot composes, else 0, shape (p,); a symbol while one differentiates."""

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
        involved = [chosen.a] if chosen.b is None else [chosen.a, chosen.b]
        parts = stacked_slices([self.x[self.parts[l]].numel() for l in involved])
        obstacle = None if chosen.obstacle is None else 0
        return ComposedSet(
            members=tuple(self.members[l] for l in involved),
            x=ca.vertcat(*[self.x[self.parts[l]] for l in involved]),
            parts=parts,
            positions=tuple(self.positions[l] for l in involved),
            obstacles=() if chosen.obstacle is None else (self.obstacles[chosen.obstacle],),
            pairs=(Pair(0, None if chosen.b is None else 1, obstacle),),
            h=self.h[pair],
            h_tot=self.h[pair],
            sigma=self.sigma,
            active=self.active[pair],
        )

    def within(self, i: int, radius: float) -> ca.SX:
        """1 for pairs whose both sides lie within `radius` [m] of agent i, shape (p,)."""
        near = [ca.norm_2(p - self.positions[i]) <= radius for p in self.positions]
        near[i] = ca.SX(1)
        hit = [o.distance(self.positions[i]) <= radius for o in self.obstacles]
        return ca.vertcat(*[near[p.a] * _other(p, near, hit) for p in self.pairs])

    def label(self, pair: Pair) -> str:
        """A pair in words: "1-4", or "1-obstacle 2"."""
        other = f"obstacle {pair.obstacle}" if pair.b is None else self.members[pair.b].name
        return f"{self.members[pair.a].name}-{other}"


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
    obstacles: Sequence[Obstacle],
    function: SafeSetFunction,
    rho: float,
) -> ComposedSet:
    """The safe set of a whole swarm: every pair that involves a normal agent, joined by LSE.

    Raises ValueError if there is no normal agent, or no pair at all.
    """
    parts = stacked_slices([len(m.dynamics.states) for m in members])
    x = ca.vertcat(*[ca.SX.sym(f"x_{m.name}", len(m.dynamics.states)) for m in members])
    bodies = [
        Body(x[part], m.dynamics.position(x[part]), tuple(m.dynamics.states), m.adversary)
        for m, part in zip(members, parts, strict=True)
    ]
    normal = [i for i, m in enumerate(members) if not m.adversary]
    if not normal:
        raise ValueError("expected at least one normal agent, got none")
    pairs = [Pair(i, j) for i in normal for j in normal if i < j]
    pairs += [Pair(i, j) for i in normal for j, m in enumerate(members) if m.adversary]
    pairs += [Pair(i, None, k) for i in normal for k in range(len(obstacles))]
    if not pairs:
        raise ValueError("expected a second agent or an obstacle, got one agent alone")
    h = ca.vertcat(*[_pair_function(pair, bodies, obstacles, function) for pair in pairs])
    sigma, active = ca.SX.sym("sigma"), ca.SX.sym("active", len(pairs))
    h_tot = log_sum_exp(_only(h, active), rho, sigma)
    positions = tuple(body.p for body in bodies)
    return ComposedSet(
        tuple(members), x, parts, positions, tuple(obstacles), tuple(pairs), h, h_tot, sigma, active
    )


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


def _pair_function(
    pair: Pair, bodies: Sequence[Body], obstacles: Sequence[Obstacle], function: SafeSetFunction
) -> ca.SX:
    if pair.b is not None:
        return function.between(bodies[pair.a], bodies[pair.b])
    assert pair.obstacle is not None
    return function.to_obstacle(bodies[pair.a], obstacles[pair.obstacle])
