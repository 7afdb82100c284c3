"""How long no pair of an agent can become unsafe, whatever anybody does, if it holds its input.

From the true state and the input that is applied alone: who made the input, and from what, has no
part in it. A pair's certificate is the best of three bounds, each over several horizons: of h over
the box that can be reached, of h integrated (q > 1), and of ψ_{q-1} integrated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, extend
from phalanx.theory.margins.enclosure import (
    Enclosure,
    admissible_inputs,
    enclose,
    fastest,
    moved,
    scalars,
)
from phalanx.theory.margins.integrated import INFLATIONS, growth, keeps_chain, time_until_zero
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import ComposedSet, Member

Array = NDArray[np.float64]

MULTIPLES = (8.0, 4.0, 2.0, 1.0 + 1e-9)
"""The horizons that are tried, in τ: over a longer one the box is larger. The last is above τ, for
sums of sampling periods round, and a certificate that is over before the next input is none."""


@dataclass(frozen=True)
class PairCertificate:
    """Of one pair, for agent i in it."""

    horizons: tuple[float, ...]
    """What is tried, the longest first [s]."""
    proven: CompiledFunction | None
    """(x, u_i, T) -> how much of [0, T] is proven safe [s]; None if nothing ever is."""
    refused: str = ""
    """What could not be bounded, in words."""

    def horizon(self, x: Array, u: Array) -> float:
        """How long h <= 0 is proven from now on [s]; 0 if not at all.

        Args:
            x: the pair's state, its members' in order.
            u: the input that agent i holds, shape (m_i,).
        """
        best = 0.0
        for horizon in self.horizons:
            if self.proven is None or best >= horizon:
                break
            best = max(best, float(self.proven(x, u, horizon)[0][0]))
        return best


def pair_certificate(
    pair: ComposedSet,
    own: int,
    alphas: Sequence[ClassK],
    bounds: Sequence[float],
    longest: float,
) -> PairCertificate:
    """Compile one pair's certificate.

    Args:
        pair: one pair alone.
        own: agent i's place in it.
        alphas: α_1 ... α_q; the last has no part in it.
        bounds: φ_l^max of each member.
        longest: τ = Γ_i + δ_i^max and the latency [s].
    """
    horizons = tuple(multiple * longest for multiple in MULTIPLES)
    horizon = ca.SX.sym("T")
    try:
        moving = [
            enclose(
                member,
                pair.x[part],
                None if l == own else admissible_inputs(member),
                bounds[l],
                horizon,
                INFLATIONS,
            )
            for l, (member, part) in enumerate(zip(pair.members, pair.parts, strict=True))
        ]
    except ValueError as error:
        return PairCertificate(horizons, None, str(error))
    chain = build_chain(pair, alphas, None, bounds)

    def reached() -> ca.SX:
        return ca.if_else(_highest(pair.h_tot, moving) <= 0, horizon, 0)

    def integrated(value: ca.SX) -> ca.SX:
        return time_until_zero(growth(value, pair, own, moving, bounds), horizon)

    def kept() -> ca.SX:
        return ca.if_else(keeps_chain(chain, alphas, moving), integrated(chain.psi[-1]), 0)

    kinds: list[Callable[[], ca.SX]] = [reached, lambda: integrated(pair.h_tot)]
    kinds += [kept] if chain.relative_degree > 1 else []
    times, refused = [], []
    for kind in kinds:
        try:
            times.append(kind())
        except UnboundedOperationError as error:
            refused.append(str(error))
    if not times:
        return PairCertificate(horizons, None, "; ".join(refused))
    proven = CompiledFunction([pair.x, moving[own].u, horizon], [ca.mmax(ca.vertcat(*times))])
    return PairCertificate(horizons, proven, "; ".join(refused))


Known = dict[tuple[object, ...], PairCertificate]
"""Certificates by what sets their pairs apart: i's place, the members' groups, and h."""


class AgentCertificates:
    """Of all pairs of normal agent i, compiled once."""

    def __init__(self, swarm: Swarm, i: int, known: Known) -> None:
        """known: certificates of agents of the swarm that were compiled before; added to."""
        composed, tau = swarm.safe_set, swarm.horizon(i)
        self.pairs = tuple(n for n, p in enumerate(composed.pairs) if i in (p.a, p.b))
        """Indices of agent i's pairs in the composed set."""
        self.tau = tau
        """τ = Γ_i + δ_i^max and the latency [s]."""
        self._longest = MULTIPLES[0] * tau
        self._certificates, self._states = [], []
        for number in self.pairs:
            pair = composed.pairs[number]
            involved = [pair.a] if pair.b is None else [pair.a, pair.b]
            own = involved.index(i)
            alone = composed.alone(number)
            alike = (own, *[id(swarm.groups[l]) for l in involved], _written(alone))
            if alike not in known:
                bounds = [swarm.disturbance_bounds[swarm.names[l]] for l in involved]
                alphas = swarm.scenario.safety.class_k()
                known[alike] = pair_certificate(alone, own, alphas, bounds, tau)
            self._certificates.append(known[alike])
            self._states.append(np.concatenate([np.r_[composed.parts[l]] for l in involved]))
        self._highest = _highest_of_all(swarm, self.pairs, self._longest)

    @property
    def refused(self) -> dict[int, str]:
        """Pairs that no input of the agent's can ever certify, by index, and why."""
        known = zip(self.pairs, self._certificates, strict=True)
        return {pair: each.refused for pair, each in known if each.proven is None}

    def __call__(self, x: Array, u: Array) -> Array:
        """How long each pair's h <= 0 is proven from now on [s], in the order of `pairs`.

        Args:
            x: the true stacked state, shape (n̄,).
            u: the input that agent i holds from now on, shape (m_i,).
        """
        (highest,) = self._highest(x)
        # Most pairs are too far apart to meet within the longest horizon.
        times: Array = np.where(highest <= 0.0, self._longest, 0.0)
        for k in np.flatnonzero(times == 0.0):
            times[k] = self._certificates[k].horizon(x[self._states[k]], u)
        return times


def _written(pair: ComposedSet) -> str:
    """h as a text, whatever the states are called: a user's may tell agents of one group apart."""
    x = ca.SX.sym("x", pair.x.numel())
    text: str = ca.Function("h", [x], [ca.substitute(pair.h_tot, pair.x, x)]).serialize()
    return text


def _highest_of_all(swarm: Swarm, pairs: Sequence[int], horizon: float) -> CompiledFunction:
    """x -> the highest that each pair's h can be within the horizon; inf if unknown.

    Whatever all agents do, agent i too: with few operations, to be done with most pairs.
    """
    composed = swarm.safe_set
    reach: dict[int, Reach] = {}
    highest = []
    for number in pairs:
        pair = composed.pairs[number]
        involved = [l for l in (pair.a, pair.b) if l is not None]
        try:
            for l in involved:
                x = composed.x[composed.parts[l]]
                bound = swarm.disturbance_bounds[swarm.names[l]]
                reach[l] = reach.get(l) or _reach(swarm.members[l], x, bound, horizon)
            highest.append(_highest(composed.h[number], [reach[l] for l in involved]))
        except ValueError:  # a pair that is refused
            highest.append(ca.SX(ca.inf))
    return CompiledFunction([composed.x], [ca.vertcat(*highest)])


class Reach(NamedTuple):
    """Where one agent's state can be within a horizon."""

    x: ca.SX
    states: list[Interval]
    certain: ca.SX
    """1 if the state is proven to stay there."""


def _reach(member: Member, x: ca.SX, bound: float, horizon: float) -> Reach:
    inputs = admissible_inputs(member)
    rates = fastest(member, inputs, bound)
    if rates is not None:
        return Reach(x, moved(x, rates, horizon), ca.SX(1))
    e = enclose(member, x, inputs, bound, horizon, INFLATIONS)
    return Reach(x, e.states, e.certain)


def _highest(h: ca.SX, reach: Sequence[Reach | Enclosure]) -> ca.SX:
    """sup of h over the boxes, which needs no continuity; inf where it is unknown."""
    boxes = [interval for r in reach for interval in r.states]
    (found,) = extend([h], scalars([r.x for r in reach]), boxes)
    certain = ca.SX(1)
    for r in reach:
        certain = ca.logic_and(certain, r.certain)
    return ca.if_else(certain, found.hi, ca.inf)
