"""Extremes of the true h of every pair, over all integration steps."""

from collections import defaultdict

import numpy as np

from phalanx.arrays import Array, Index, Mask
from phalanx.guarantee.verdict import Violation
from phalanx.theory.expressions.exact import dot
from phalanx.theory.safety.composition import ComposedSet
from phalanx_plant.world.evaluation import EvaluatedSteps


class _Violations:
    """Depth and duration of each pair's violations of the safe set."""

    def __init__(self, count: int) -> None:
        self._worst = np.full(count, -np.inf)
        self._worst_at = np.zeros(count)
        self._first = np.full(count, np.inf)
        self._duration = np.zeros(count)

    def add(self, times: Array, lengths: Array, pairs: Index, h: Array, unsafe: Mask) -> None:
        """Add s integration steps of these lengths [s]: h and h > 0 of some pairs, (s, r)."""
        highest = h.max(axis=0)
        deeper = highest > self._worst[pairs]
        self._worst_at[pairs[deeper]] = times[h.argmax(axis=0)][deeper]
        self._worst[pairs[deeper]] = highest[deeper]
        self._duration[pairs] += dot(unsafe.T.astype(np.float64), lengths)
        first = np.where(unsafe.any(axis=0), times[unsafe.argmax(axis=0)], np.inf)
        self._first[pairs] = np.minimum(self._first[pairs], first)

    def sorted(self, composed: ComposedSet) -> list[Violation]:
        """Return all violations, the deepest first."""
        found = [
            Violation(
                composed.label(composed.pairs[p]),
                float(self._first[p]),
                float(self._worst[p]),
                float(self._worst_at[p]),
                float(self._duration[p]),
            )
            for p in np.flatnonzero(self._first < np.inf).tolist()
        ]
        return sorted(found, key=lambda v: -v.worst)


class PairExtremes:
    """Running extremes of every pair's h and of h_tot."""

    def __init__(self, composed: ComposedSet) -> None:
        self._composed, count = composed, len(composed.pairs)
        self._t = 0.0
        self._worst_pair = 0
        self.largest_h = -np.inf
        """Largest h of a pair so far."""
        self._counted, self._apart = _Violations(count), _Violations(count)
        self._is_apart = np.zeros(count, dtype=bool)
        self.worst_h_tot = -np.inf
        """Largest h_tot so far."""
        self.worst_at = 0.0
        """Time of the largest h_tot [s]."""
        self.largest = 0
        """The pair whose h was largest at the last step."""
        self.h_tot = -np.inf
        """At the last step."""
        self._peaks: dict[int, float] = {}
        """By number of a history, its largest h_tot, the value before it included."""
        self._unsafe: defaultdict[int, list[tuple[Array, Array, Index, Array]]] = defaultdict(list)
        """By history, times, lengths, pairs and h of steps that left the safe set, if any did."""

    @property
    def worst_pair(self) -> str:
        """The pair whose h was largest."""
        return self.label(self._worst_pair)

    def label(self, pair: int) -> str:
        """Name of a pair, by its index."""
        return self._composed.label(self._composed.pairs[pair])

    def left(self, pair: int) -> str:
        """Message that a pair left the safe set."""
        apart = ", set apart: there is no normal agent in it any more"
        return f"{self.label(pair)} left the safe set{apart if self._is_apart[pair] else ''}"

    def add(self, steps: EvaluatedSteps) -> None:
        """Add integration steps."""
        numbers, times, pairs, h, h_tot, *_ = steps
        at = int(h.argmax())
        if (highest := float(h.flat[at])) > self.largest_h:
            self.largest_h, self._worst_pair = highest, int(pairs[at % h.shape[1]])
        self.largest = int(pairs[h[-1].argmax()])
        highest_at = int(h_tot.argmax())
        peak = float(h_tot[highest_at])
        if peak > self.worst_h_tot:
            self.worst_h_tot, self.worst_at = peak, float(times[highest_at])
        for number, value in zip(numbers.tolist(), h_tot.tolist(), strict=True):
            if number not in self._peaks:
                self._peaks[number] = self.h_tot
            if value > self._peaks[number]:
                self._peaks[number] = value
            self.h_tot = value
        if not peak <= 0.0:
            self._keep_unsafe(steps)
        self._t = float(times[-1])

    def _keep_unsafe(self, steps: EvaluatedSteps) -> None:
        lengths = np.diff(steps.times, prepend=self._t)
        for number in np.unique(steps.numbers).tolist():
            own = steps.numbers == number
            # LSE is never below the largest h: with h_tot <= 0 no pair is unsafe. NaN is not safe.
            if not steps.h_tot[own].max() <= 0.0:
                part = steps.times[own], lengths[own], steps.pairs, steps.h[own]
                self._unsafe[number].append(part)

    def take(self, number: int) -> tuple[float, set[int]]:
        """Return the largest h_tot in a history, and the pairs that were outside their safe sets.

        The value of h_tot before it counts too.
        """
        outside = set[int]()
        for times, lengths, pairs, h in self._unsafe.pop(number, ()):
            unsafe, apart = ~(h <= 0.0), self._is_apart[pairs]
            outside.update(pairs[unsafe.any(axis=0)].tolist())
            for violations, some in ((self._counted, ~apart), (self._apart, apart)):
                if some.any():
                    violations.add(times, lengths, pairs[some], h[:, some], unsafe[:, some])
        return self._peaks.pop(number, self.h_tot), outside

    def set_apart(self, pairs: Index) -> None:
        """Stop counting these pairs, which have no normal agent any more, against the verdict."""
        self._is_apart[pairs] = True

    def violations(self) -> list[Violation]:
        """Pairs with h > 0 at some step, the deepest first."""
        return self._counted.sorted(self._composed)

    def apart(self) -> list[Violation]:
        """The same for pairs since they were set apart."""
        return self._apart.sorted(self._composed)
