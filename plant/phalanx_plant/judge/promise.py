"""The promise made before a run: kept, or broken by what, from true states and applied inputs.

The judge runs each normal agent's rule on the true states, with the inputs that were applied. What
the rule would have let through, or its fallback does, is answered with itself; all else breaks the
promise of that agent. No agent is asked.
"""

from collections.abc import Collection, Sequence

import numpy as np

from phalanx.guarantee.promise import grades
from phalanx.guarantee.verdict import BrokenPromise, PromiseSummary, Violation
from phalanx.swarm.flight import keeper
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Mask
from phalanx_plant.world.events import InputApplied
from phalanx_plant.world.world import DisturbanceKnot

_ROUNDING = 1e-9


class PromiseLedger:
    """The promises of one run, each kept until something breaks it."""

    def __init__(self, swarm: Swarm) -> None:
        """Begin at x(0)."""
        self._swarm, promised = swarm, grades(swarm)
        self._refused = "; ".join(promised.refusals)
        pairs, safe_set = [pair[:2] for pair in swarm.safe_set.pairs], swarm.safe_set
        labels = self._numbers = {safe_set.label(p): k for k, p in enumerate(safe_set.pairs)}
        """Of pairs by their labels."""
        self._pairs = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        distances = [labels[p] for p in (*promised.for_ever, *promised.until)]
        self._for_ever = np.isin(np.arange(len(pairs)), distances)
        self._until = np.full(len(pairs), np.inf)
        """By pair until when it is promised at most [s]."""
        for pair, time in promised.until.items():
            self._until[labels[pair]] = time
        both = [[(a, b) in promised.sides, (b, a) in promised.sides] for a, b in pairs]
        self._aside = np.array(both, dtype=bool).reshape(-1, 2)
        """By pair and side, whether it is promised not to hit the other; shape (p, 2)."""
        self._keepers = {i: keeper(swarm, i, true_states=True) for i in swarm.normal}
        self._last = dict.fromkeys(swarm.normal, 0.0)
        """By agent, the time of its last sample [s]."""
        self._stands: dict[int, list[tuple[float, bool]]] = {i: [] for i in swarm.normal}
        """By agent, whether it stood from each time on, where that changed."""
        self._silent = set[int]()
        self._turned = dict[int, float]()
        self._broken = dict[int, BrokenPromise]()
        self._bounds = np.array([g.disturbance.bound for g in swarm.groups]) * (1.0 + _ROUNDING)
        self._begins = [part.start for part in swarm.safe_set.parts]

    def disturbed(self, knot: DisturbanceKnot) -> None:
        """Check the bounds of all disturbances; that of an adversary is counted too."""
        norms = np.sqrt(np.add.reduceat(knot.phi * knot.phi, self._begins))
        for l in np.flatnonzero(~(norms <= self._bounds)).tolist():
            name = self._swarm.names[l]
            for i in (l,) if l in self._keepers else self._keepers:
                self._break(i, knot.t, f"the disturbance of {name} is above its bound")

    def sampled(self, i: int, t: float) -> None:
        """Check the gap since a normal agent's last sample."""
        if i in self._keepers:
            self._check_gap(i, t)
            gap, shortest = t - self._last[i], self._keepers[i].shortest
            if 0.0 < gap < shortest - _ROUNDING and self._last[i]:
                self._break(i, t, "a sample came early")
            self._last[i] = t

    def applied(self, event: InputApplied, x: Array, truthful: bool) -> None:
        """Check an input against the rule; x: the true state at its sample, shape (n̄,)."""
        i, t = event.i, event.t_sample
        if i in self._turned or i not in self._keepers:
            return
        rule = self._keepers[i]
        # Whom the agent does not see is too far to matter.
        answer = rule(t, x, range(len(self._swarm.members)), event.u)
        if not np.array_equal(answer.u, event.u):
            why = "an input that the rule does not let through"
            self._break(i, t, why if truthful else f"{why}: its sample was false")
        if event.t_apply > t + _ROUNDING:
            self._break(i, t, "an input came late")
        stood = self._stands[i]
        if not stood or stood[-1][1] != rule.stands:
            stood.append((t, rule.stands))

    def lost(self, i: int, t: float) -> None:
        """Record that an input of agent i's never reached its actuator."""
        self._break(i, t, "an input was lost")

    def fell_silent(self, i: int) -> None:
        """Record that agent i does not sample any more."""
        self._silent.add(i)

    def restarted(self, i: int) -> None:
        """Record that another process has taken over: it knows of no fallback under way."""
        self._silent.discard(i)
        if i in self._keepers:
            self._keepers[i].restart()

    def turned(self, i: int, t: float) -> None:
        """Record that agent i attacks from t [s] on: nothing is promised of what it does."""
        self._turned.setdefault(i, t)

    def failed(self, t: float, why: str) -> None:
        """Break every promise."""
        for i in self._keepers:
            self._break(i, t, why)

    def summary(self, t: float, violations: Sequence[Violation]) -> PromiseSummary:
        """Return which promises are kept at t [s]; violations: of pairs, by the true states."""
        for i in self._keepers:
            if i not in self._turned:
                self._check_gap(i, t)
        acting = self._among(self._keepers.keys() - self._turned.keys())
        whole = (acting == self._among(self._keepers)).all(axis=1)
        for_ever = self._for_ever & whole
        passively = ~for_ever & acting.any(axis=1) & (~acting | self._aside).all(axis=1)
        promised, broken = for_ever | passively, list(self._broken.values())
        kept = promised & ~(acting & self._among(self._broken)).any(axis=1)
        for excursion in violations:
            k = self._numbers[excursion.pair]
            sides = self._pairs[k][acting[k]].tolist()
            at_rest = not for_ever[k] and self._hit_at_rest(sides, excursion)
            if kept[k] and excursion.first <= self._until[k] and not at_rest:
                names = "-".join(self._swarm.names[i] for i in sides)
                why = f"{excursion.pair} was unsafe"
                broken.append(BrokenPromise(names, excursion.first, why))
                kept[k] = False
        broken.sort(key=lambda b: b.t)
        turned = {self._swarm.names[i]: at for i, at in self._turned.items()}
        lasting, every = self._until < np.inf, int(np.sum(promised))
        by_grade = for_ever & ~lasting, passively, lasting
        first, second, until = (int(np.sum(grade & kept)) for grade in by_grade)
        return PromiseSummary(first, second, every, broken, turned, self._refused, until)

    def _among(self, agents: Collection[int]) -> Mask:
        """Return by pair and side whether it is one of these agents, shape (p, 2)."""
        return np.isin(self._pairs, [*agents])

    def _hit_at_rest(self, sides: Sequence[int], excursion: Violation) -> bool:
        """Return whether all of these stood when a pair's excursions began."""
        return all(self._stood(i, at) for i in sides for at in (excursion.first, excursion.begin))

    def _stood(self, i: int, t: float) -> bool:
        earlier = [stands for since, stands in self._stands[i] if since <= t]
        return bool(earlier) and earlier[-1]

    def _check_gap(self, i: int, t: float) -> None:
        due = self._last[i] + self._keepers[i].longest
        if t > due + _ROUNDING:
            silent = i in self._silent
            self._break(i, due, "it fell silent" if silent else "a sample came late")

    def _break(self, i: int, t: float, why: str) -> None:
        if i not in self._turned:
            self._broken.setdefault(i, BrokenPromise(self._swarm.names[i], t, why))
