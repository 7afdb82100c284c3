"""The seeds of a run over time, and the tables of draws that follow them.

A draw belongs to the virtual time at which the run decides it. It is that of the seed in force
then. What was decided before keeps its value: a message under way arrives when it would have.
"""

from bisect import bisect_right
from collections.abc import Iterable
from operator import itemgetter

from phalanx.seeded.draws import Draws

_AT = itemgetter(0)


class Seeds:
    """The seed of a run, and those that replace it from given times on."""

    def __init__(self, first: int, later: Iterable[tuple[float, int]] = ()) -> None:
        """later: times [s], increasing, each with the seed in force from then on."""
        self.first, self.later = first, list(later)

    def at(self, t: float) -> int:
        """Return the seed in force at t [s]."""
        place = bisect_right(self.later, t, key=_AT)
        return self.later[place - 1][1] if place else self.first

    def change(self, t: float, seed: int) -> None:
        """Put another seed in force from t [s] on, in a run that has decided nothing from then on.

        Raises ValueError: another one is in force from t or later.
        """
        if self.later and t <= self.later[-1][0]:
            raise ValueError(f"at: expected more than {self.later[-1][0]:g} s, got {t:g}")
        self.later.append((t, seed))


class Tables:
    """Tables of draws whose rows are decided one after the other in time."""

    def __init__(self, seeds: Seeds | int, *purpose: str, width: int = 1) -> None:
        """Name the tables by what their purposes have in common; width: of their rows."""
        self._seeds = Seeds(seeds) if isinstance(seeds, int) else seeds
        self._purpose, self._width = purpose, width
        self._later: list[tuple[int, int]] = []
        self._made: dict[str, Draws] = {}

    def __call__(self, purpose: str = "") -> Draws:
        """Return the table of one purpose, as far as it is decided."""
        if purpose not in self._made:
            name = (*self._purpose, purpose) if purpose else self._purpose
            made = Draws(self._seeds.first, *name, width=self._width, later=self._later)
            self._made[purpose] = made
        return self._made[purpose]

    def decide(self, row: int, t: float) -> "Tables":
        """Return the tables, of which this row, and no later one, is decided at t [s]."""
        for at, seed in self._seeds.later[len(self._later) :]:
            if t < at:
                break
            self._later.append((row, seed))
            self._made.clear()
        return self
