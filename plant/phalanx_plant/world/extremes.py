"""Extremes of the true h of every pair, over all integration steps."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from phalanx.guarantee.verdict import Violation
from phalanx.theory.arrays import Array, Index, Mask
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

    def add(self, steps: EvaluatedSteps, counting: Mask) -> list[tuple[int, Crossing]]:
        """Add steps; counting: which of their pairs count here, shape (r,).

        Returns the pairs that left or came back, each with the number of its history.
        """
        numbers, times, pairs, h, *_ = steps
        self._t, outside = float(times[-1]), ~(h <= 0.0)
        columns = np.flatnonzero(outside.any(axis=0) & counting).tolist()
        some = {int(pairs[c]): c for c in columns}
        crossings = [
            (0, -1, Crossing(float(times[0]), p, False)) for p in self.lasting - some.keys()
        ]
        for pair, c in some.items():
            edges = np.flatnonzero(np.diff(outside[:, c], prepend=pair in self.lasting)).tolist()
            crossings += [
                (k, c, Crossing(float(times[k]), pair, bool(outside[k, c]))) for k in edges
            ]
        # Violations as deep as one another stay in the order of their histories and pairs.
        crossings.sort(key=lambda edge: (numbers[edge[0]], *edge[1::-1]))
        for _, _, crossing in crossings:
            self._cross(*crossing)
        for pair, c in some.items():
            violation, worst = self._violations[pair], float(h[:, c].max())
            if worst > violation.worst:
                violation.worst, violation.worst_at = worst, float(times[h[:, c].argmax()])
        return [(int(numbers[k]), crossing) for k, _, crossing in crossings]

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


Peak = tuple[float, float]
"""Largest h_tot, and largest h of a pair with a normal agent."""
LOWEST: Peak = (-np.inf, -np.inf)


def larger(a: Peak, b: Peak) -> Peak:
    """Return the larger values of both."""
    return max(a[0], b[0]), max(a[1], b[1])


class Extremes(NamedTuple):
    """Extremes of n consecutive histories."""

    peaks: Array
    """Their largest h_tot and largest h that counts, or the values before each; shape (n, 2)."""
    pairs: Index
    """The pair whose h is largest at the end of each, shape (n,)."""
    crossings: list[tuple[int, Crossing]]
    """Pairs that left or came back, each with the number of its history, in order."""

    def peak(self, number: int) -> Peak:
        """Return the largest values of one history."""
        h_tot, h = self.peaks[number].tolist()
        return h_tot, h


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
        self._now, self._largest = np.array([LOWEST]), np.zeros(1, dtype=np.intp)
        """h_tot and the largest h that counts at the last step, shape (1, 2), and that pair."""

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

    def add(self, evaluated: Sequence[EvaluatedSteps], count: int) -> Extremes:
        """Add the steps of the next histories, so many: some may have none."""
        crossings = list[tuple[int, Crossing]]()
        # The last step before them comes first.
        values, largest = [self._now], [self._largest]
        for steps in evaluated:
            excluded = self._is_excluded[steps.pairs]
            counted = np.where(excluded, -np.inf, steps.h) if excluded.any() else steps.h
            column = counted.argmax(axis=1)
            h = counted[np.arange(len(column)), column]
            self._keep_largest(steps.times, steps.h_tot, h, steps.pairs[column])
            values.append(np.column_stack([steps.h_tot, h]))
            largest.append(steps.pairs[column])
            # LSE is never below the largest h: with h_tot <= 0 no pair is unsafe. NaN is not safe.
            safe = (steps.h_tot <= 0.0).all()
            if not safe or self._counted.lasting or self._uncounted.lasting:
                crossings += self._counted.add(steps, ~excluded)
                crossings += self._uncounted.add(steps, excluded)
        table, pairs = np.concatenate(values), np.concatenate(largest)
        numbers = np.concatenate([np.zeros(0, dtype=np.intp), *[s.numbers for s in evaluated]])
        ends = np.searchsorted(numbers, np.arange(-1, count), side="right")
        # A window from the step before each history to its last one: every second of these.
        windows = np.column_stack([ends[:-1], ends[1:] + 1]).ravel()
        peaks = np.maximum.reduceat(np.concatenate([table, table[:1]]), windows)[::2]
        self._now, self._largest = table[-1:], pairs[-1:]
        return Extremes(peaks, pairs[ends[1:]], sorted(crossings))

    def _keep_largest(self, times: Array, h_tot: Array, h: Array, pairs: Index) -> None:
        """Keep the largest values so far, and when each was reached first."""
        if h[k := int(h.argmax())] > self.worst_h:
            self.worst_h, self.worst_at = float(h[k]), float(times[k])
            self.worst_pair = self.label(int(pairs[k]))
        if h_tot[k := int(h_tot.argmax())] > self.largest_h_tot:
            self.largest_h_tot, self.largest_h_tot_at = float(h_tot[k]), float(times[k])

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
