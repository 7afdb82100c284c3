"""Promises before a run: which pairs keep their distance for ever, or passively, and why not.

At t = 0 an agent is committed to no input until its first sample, then its fallback. Two of these
tubes R apart, and the rule of commitments, keep a pair of normal agents *for ever*. *Passively* an
agent hits no other while it moves by itself, though it may be hit once it stands.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.promise.capsules import Capsules, joined
from phalanx.swarm.committed import flights_of, reach_of
from phalanx.swarm.flight import FlightKeeper, keeper
from phalanx.swarm.keep import Keeper, Refusal, refusals_of
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array

_MOST = 6
"""Most pairs that a sentence names."""


_Spare = dict[tuple[int, int], float]
"""What pairs have to spare at the start [m]: two agents; an agent and a member, or obstacle."""


class Grades(NamedTuple):
    """The grade of each pair with a normal agent, by its label."""

    for_ever: tuple[str, ...] = ()
    passively: tuple[str, ...] = ()
    until: Mapping[str, float] = {}
    """By pair with one that is faster the time for which it is promised [s]."""
    faster: str = ""
    """Who that is, for the first of them, with both speeds."""
    short: Mapping[str, str] = {}
    """By pair the number that is short, and the value that would do."""
    refusals: tuple[str, ...] = ()
    """What keeps whole agents from any promise."""
    sides: frozenset[tuple[int, int]] = frozenset()
    """Agents that are promised not to hit a member themselves: (agent, member)."""

    def sentences(self, committed: bool, proven: Mapping[str, float]) -> list[str]:
        """Return what is promised, the strongest first.

        Args:
            committed: whether agents keep the rule in a run.
            proven: by pair the time for which it is safe under any filter [s].
        """
        if self.refusals:
            short = [why for why in self.refusals if why.startswith("disturbance.bound")]
            return [f"safety.keep = 'hold' could promise nothing: {why}." for why in short[:1]]
        with_rule = "" if committed else "With safety.keep = 'hold': p"
        promise = f"{with_rule or 'P'}romised before the run, under any filter and network: "
        parts = [
            f"{_listed(pairs)} {grade}"
            for pairs, grade in ((self.for_ever, "for ever"), (self.passively, "passively"))
            if pairs
        ]
        for time in sorted({*self.until.values()}, reverse=True):
            pairs = tuple(pair for pair, at in self.until.items() if at == time)
            parts.append(f"{_listed(pairs)} until {_rounded_down(time)}")
        faster = f", as {self.faster}" if self.until else ""
        words = [promise + ("; ".join(parts) or "nothing") + f"{faster}."]
        if self.passively and committed:
            words.append(
                "Passively: an agent hits no other while it moves by itself, whatever attacks; one "
                "that stands may be hit."
            )
        lacking = [
            f"{pair}: {why}"
            + (f", safe for {_rounded_down(proven[pair])}" if pair in proven else "")
            for pair, why in self.short.items()
        ]
        return words + ([f"Not promised: {_first(lacking)}."] if lacking else [])


def grades(swarm: Swarm) -> Grades:
    """Return the grades of all pairs at x(0)."""
    x, refusals = swarm.start(), dict[int, Refusal]()
    for i in swarm.normal:
        if found := refusals_of(swarm, i):
            refusals[i] = found[0]
    if refusals:
        return Grades(refusals=tuple(dict.fromkeys(map(str, refusals.values()))))
    keepers = {i: keeper(swarm, i) for i in swarm.normal}
    distances, passive, to_obstacles = _Spare(), _Spare(), _Spare()
    everyone = np.arange(len(swarm.members))
    tubes = {
        i: rule.tube(x, _nothing(swarm, i))
        for i, rule in keepers.items()
        if isinstance(rule, Keeper)
    }
    for i, rule in keepers.items():
        room, exits = rule.room(x, everyone, _nothing(swarm, i)), swarm.safety.leaves
        others = [l for l in everyone.tolist() if l != i and not (exits and l in rule.peers)]
        passive |= {(i, l): gap for l, gap in zip(others, room.members.tolist(), strict=True)}
        to_obstacles |= {(i, k): gap for k, gap in enumerate(room.obstacles.tolist())}
        later = {l: tubes[l] for l in rule.peers if l > i}
        if later:
            for l, gap in _gaps(tubes[i], later).items():
                distances[i, l] = gap - rule.radius
    return _graded(swarm, keepers, distances, passive, to_obstacles)


def _graded(
    swarm: Swarm,
    keepers: Mapping[int, Keeper | FlightKeeper],
    distances: _Spare,
    passive: _Spare,
    to_obstacles: _Spare,
) -> Grades:
    """Return the grades."""
    for_ever, passively = list[str](), list[str]()
    until, short, members = dict[str, float](), dict[str, str](), len(swarm.members)
    for pair in swarm.safe_set.pairs:
        (a, b), label, time = pair[:2], swarm.safe_set.label(pair), math.inf
        if b >= members:
            spare, grade = to_obstacles[a, b - members], for_ever
        elif (a, b) in distances:
            spare, grade = distances[a, b], for_ever
        else:
            sides = [(i, l) for i, l in ((a, b), (b, a)) if i in keepers]
            spare = min(passive[side] for side in sides)
            grade = for_ever if swarm.safety.leaves else passively
            time = min([keepers[i].until for i, l in sides if l in keepers[i].faster], default=time)
        if spare < 0.0 or time == 0.0:
            short[label] = _reason(swarm, b, spare)
        elif time < math.inf:
            until[label] = time
        else:
            grade.append(label)
    stopping = not swarm.safety.leaves
    aside = frozenset(side for side, spare in passive.items() if spare >= 0.0 and stopping)
    fast = sorted(l for rule in keepers.values() for l in rule.faster)
    faster = _speeds(swarm, fast[0]) if fast else ""
    return Grades(tuple(for_ever), tuple(passively), until, faster, short, sides=aside)


def _reason(swarm: Swarm, l: int, spare: float) -> str:
    """Return what is short of a pair with member l."""
    if spare < 0.0 and np.isfinite(spare):
        return f"{-spare:.3g} m nearer than it may start"
    return _speeds(swarm, l) if swarm.safety.leaves else "the other's reach is no finite number"


def _speeds(swarm: Swarm, l: int) -> str:
    """Return that member l is as fast as agents can leave."""
    speed = reach_of(swarm, l).for_ever(swarm.start()[swarm.safe_set.parts[l]])[1]
    name, velocity = swarm.names[l], swarm.safety.exit_velocity
    if velocity is None:
        flights = flights_of(swarm, swarm.normal[0])
        return f"{name} makes {speed:.3g} m/s, a flight {flights.speed - flights.drift:.3g}"
    return f"{name} makes {speed:.3g} m/s, the exit {math.hypot(*velocity):.3g}"


def _gaps(tube: Capsules, others: Mapping[int, Capsules]) -> dict[int, float]:
    """Return how far each of the others' tubes is [m]."""
    gaps = tube.gaps(joined(list(others.values()), tube.begin.shape[1]))
    ends = np.cumsum([len(other.radius) for other in others.values()])[:-1]
    parts = np.split(gaps, ends)
    return {l: float(part.min()) for l, part in zip(others, parts, strict=True)}


def _nothing(swarm: Swarm, i: int) -> Array:
    return np.zeros(len(swarm.members[i].dynamics.inputs))


def _first(reasons: Sequence[str]) -> str:
    """Return the first reasons, and how many more there are."""
    more = f"; {len(reasons) - _MOST} more" if len(reasons) > _MOST else ""
    return f"{'; '.join(reasons[:_MOST])}{more}"


def _rounded_down(time: float) -> str:
    return f"{math.floor(1e3 * time) / 1e3:.3f} s"


def _listed(pairs: tuple[str, ...]) -> str:
    """Name pairs, or the first of them and how many there are."""
    if len(pairs) <= _MOST:
        return ", ".join(pairs)
    return f"{len(pairs)} pairs ({', '.join(pairs[:2])}, ...)"
