"""Extremes of the true h of every pair, over all integration steps."""

from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from phalanx.guarantee.verdict import Violation
from phalanx.theory.arrays import Array, Index
from phalanx.theory.safety.composition import ComposedSet
from phalanx_plant.world.evaluation import EvaluatedSteps


class Crossing(NamedTuple):
    """A pair that left the safe set, or came back to it."""

    t: float
    """[s]"""
    pair: int
    unsafe: bool


class _Excursions:
    """Times at which each pair was outside the safe set, and how far."""

    def __init__(self, composed: ComposedSet) -> None:
        self._composed = composed
        self._violations: dict[int, Violation] = {}
        self.lasting: set[int] = set()
        """Pairs that are outside now."""
        self._t = 0.0

    def add(self, times: Array, unsafe: Mapping[int, Array]) -> list[Crossing]:
        """Add steps at these times [s], with the h of each pair that is unsafe at one of them."""
        self._t, lasting = float(times[-1]), self.lasting
        crossings = [Crossing(float(times[0]), pair, False) for pair in lasting - unsafe.keys()]
        for pair, h in unsafe.items():
            outside = ~(h <= 0.0)
            edges = np.flatnonzero(np.diff(outside, prepend=pair in lasting)).tolist()
            crossings += [Crossing(float(times[k]), pair, bool(outside[k])) for k in edges]
        for crossing in crossings:
            self._cross(*crossing)
        for pair, h in unsafe.items():
            violation, worst = self._violations[pair], float(h.max())
            if worst > violation.worst:
                violation.worst, violation.worst_at = worst, float(times[h.argmax()])
        return crossings

    def end(self, pairs: Index, t: float) -> None:
        """End the excursions of these pairs at t [s]."""
        for pair in self.lasting.intersection(pairs.tolist()):
            self._cross(t, pair, False)

    def _cross(self, t: float, pair: int, unsafe: bool) -> None:
        name = self._composed.label(self._composed.pairs[pair])
        first = Violation(name, t, -np.inf, t, 0.0, 0, t, None)
        violation = self._violations.setdefault(pair, first)
        self.lasting ^= {pair}
        if unsafe:
            violation.count, violation.begin, violation.end = violation.count + 1, t, None
        else:
            violation.duration, violation.end = violation.duration + t - violation.begin, t

    def violations(self) -> list[Violation]:
        """Return every pair's excursions, the deepest first; those that last until now."""
        violations = [
            replace(v, duration=v.duration + (self._t - v.begin if v.end is None else 0.0))
            for v in self._violations.values()
        ]
        return sorted(violations, key=lambda v: -v.worst)


class _Part(NamedTuple):
    """Consecutive steps of one history."""

    largest: list[tuple[float, float, float, int]]
    """h_tot, time [s], the largest h that counts, and its pair."""
    times: Array
    pairs: Index
    h: Array


Peak = tuple[float, float]
"""Largest h_tot, and largest h of a pair with a normal agent."""
LOWEST: Peak = (-np.inf, -np.inf)


def larger(a: Peak, b: Peak) -> Peak:
    """Return the larger values of both."""
    return max(a[0], b[0]), max(a[1], b[1])


class PairExtremes:
    """Running extremes of every pair's h and of h_tot."""

    def __init__(self, composed: ComposedSet) -> None:
        self._composed = composed
        self._counted, self._uncounted = _Excursions(composed), _Excursions(composed)
        self._is_excluded = np.zeros(len(composed.pairs), dtype=bool)
        self.worst_h, self.worst_at, self.worst_pair = -np.inf, 0.0, ""
        """Largest h so far of a pair with a normal agent, its time [s] and its pair."""
        self.largest_h_tot, self.largest_h_tot_at = -np.inf, 0.0
        """Largest h_tot so far, and its time [s]."""
        self.now = LOWEST
        """At the last step."""
        self.largest = 0
        """The pair with a normal agent whose h was largest at the last step."""
        self._parts: defaultdict[int, list[_Part]] = defaultdict(list)
        """By number of a history, until it is taken."""

    def label(self, pair: int) -> str:
        """Name of a pair, by its index."""
        return self._composed.label(self._composed.pairs[pair])

    def in_words(self, crossing: Crossing) -> str:
        """Message that a pair left the safe set, or is safe again."""
        if not crossing.unsafe:
            return f"{self.label(crossing.pair)} is safe again"
        excluded = ", not counted: there is no normal agent in it any more"
        more = excluded if self._is_excluded[crossing.pair] else ""
        return f"{self.label(crossing.pair)} left the safe set{more}"

    def add(self, steps: EvaluatedSteps) -> None:
        """Add integration steps; they count once their history is taken."""
        numbers, times, pairs, h, h_tot, *_ = steps
        excluded = self._is_excluded[pairs]
        counted = np.where(excluded, -np.inf, h) if excluded.any() else h
        column = counted.argmax(axis=1)
        columns = h_tot, times, counted[np.arange(len(h)), column], pairs[column]
        largest = list(zip(*(column.tolist() for column in columns), strict=True))
        ends = np.flatnonzero(np.diff(numbers)) + 1
        for begin, end in pairwise([0, *ends.tolist(), len(numbers)]):
            part = _Part(largest[begin:end], times[begin:end], pairs, h[begin:end])
            self._parts[int(numbers[begin])].append(part)

    def take(self, number: int) -> tuple[Peak, list[Crossing]]:
        """Take a history: return its largest values, and the pairs that left or came back.

        The values before it count too.
        """
        peak, crossings = self.now, list[Crossing]()
        for part in self._parts.pop(number, ()):
            for h_tot, t, h, pair in part.largest:
                if h > self.worst_h:
                    self.worst_h, self.worst_at, self.worst_pair = h, t, self.label(pair)
                if h_tot > self.largest_h_tot:
                    self.largest_h_tot, self.largest_h_tot_at = h_tot, t
                self.now, self.largest = (h_tot, h), pair
                if h_tot > peak[0] or h > peak[1]:
                    peak = larger(peak, self.now)
            crossings += self._crossings(part)
        return peak, sorted(crossings)

    def _crossings(self, part: _Part) -> list[Crossing]:
        # LSE is never below the largest h: with h_tot <= 0 no pair is unsafe. NaN is not safe.
        safe = all(h_tot <= 0.0 for h_tot, *_ in part.largest)
        if safe and not self._counted.lasting and not self._uncounted.lasting:
            return []
        unsafe = np.flatnonzero(~(part.h <= 0.0).all(axis=0)).tolist()
        outside = {int(part.pairs[k]): part.h[:, k] for k in unsafe}
        counted = {pair: h for pair, h in outside.items() if not self._is_excluded[pair]}
        excluded = {pair: outside[pair] for pair in outside.keys() - counted.keys()}
        return self._counted.add(part.times, counted) + self._uncounted.add(part.times, excluded)

    def exclude(self, pairs: Index, t: float) -> None:
        """Count these pairs, without a normal agent from t [s] on, no more for the verdict."""
        self._is_excluded[pairs] = True
        self._counted.end(pairs, t)

    def violations(self) -> list[Violation]:
        """Pairs with h > 0 at some step, the deepest first."""
        return self._counted.violations()

    def excluded(self) -> list[Violation] | None:
        """The same for pairs since they were excluded; None if none was."""
        return self._uncounted.violations() if self._is_excluded.any() else None
