"""Counter-based randomness: every draw is a pure function of (seed, purpose, index).

Call order, time and process do not matter: plant, agent and report get the same bits for the same
draw. The seed of a run may change at given times. A draw belongs to the virtual time at which the
run decides it, and is that of the seed in force then. What was decided before keeps its value: a
message under way arrives when it would have.
"""

import hashlib
import math
from bisect import bisect_right
from collections.abc import Hashable, Iterable
from functools import lru_cache
from operator import itemgetter
from typing import Protocol

import numpy as np
from numpy.random import Generator, Philox

from phalanx.theory.arrays import Array, Mask

_BLOCK = 256


class Condition(Hashable, Protocol):
    """A predicate on rows; results are cached, and serve equal conditions of the same class."""

    def __call__(self, rows: Array, /) -> Mask:
        """Return whether it holds for each row: shape (r, width) to (r,)."""


class Draws:
    """An endless table of uniform draws in [0, 1): row `index` holds `width` of them."""

    def __init__(
        self, seed: int, *purpose: str, width: int = 1, later: Iterable[tuple[int, int]] = ()
    ) -> None:
        """Name the table by seed and purpose, for example (0, "jitter", "agent-1").

        later: rows, increasing, from which on the table is that of another seed.
        """
        self._keys = [(first, key_of(new, purpose)) for first, new in ((0, seed), *later)]
        """First rows, each with the key of the generator from there on."""
        self._width = width
        self._block: tuple[int, Array] = -1, np.empty((0, width))
        """Number and rows of the block that was generated last."""
        # Named tuples of two kinds are equal if their numbers are.
        self._latest = lru_cache(maxsize=8, typed=True)(self._latest_in)

    def __getitem__(self, index: int) -> Array:
        """Return row `index` >= 0, shape (width,). Do not write to it."""
        block, row = divmod(index, _BLOCK)
        draws: Array = self._rows(block)[row]
        return draws

    def value(self, index: int, column: int = 0) -> float:
        """Return one draw of row `index` >= 0."""
        number, rows = self._block
        if number != index // _BLOCK:
            rows = self._rows(index // _BLOCK)
        return rows.item(index % _BLOCK, column)

    def last(self, index: int, holds: Condition) -> int:
        """Return the last row up to `index` for which a condition holds; 0 if there is none."""
        block, row = divmod(index, _BLOCK)
        latest = self._latest(block, holds)[row]
        while latest < 0 and block:
            block -= 1
            latest = self._latest(block, holds)[-1]
        return block * _BLOCK + max(latest, 0)

    def _rows(self, block: int) -> Array:
        number, rows = self._block
        if number != block:
            rows = self._generated(block, self._keys[0][1])
            for first, key in self._keys[1:]:
                begin = max(first - block * _BLOCK, 0)
                rows[begin:] = self._generated(block, key)[begin:]
            self._block = block, rows
        return rows

    def _generated(self, block: int, key: int) -> Array:
        # The block number is the counter's high word, so blocks never overlap.
        generator = Generator(Philox(key=key, counter=block << 192))
        return generator.random((_BLOCK, self._width))

    def _latest_in(self, block: int, holds: Condition) -> list[int]:
        """Return for each row of a block the last row up to it that meets a condition, or -1."""
        rows = np.where(holds(self._rows(block)), np.arange(_BLOCK), -1)
        return [int(row) for row in np.maximum.accumulate(rows)]


def key_of(seed: int, purpose: tuple[str, ...]) -> int:
    """Return the key of the generator of a purpose's draws, 128 bits."""
    name = "\x1f".join([str(seed), *purpose]).encode()
    return int.from_bytes(hashlib.blake2b(name, digest_size=16).digest(), "little")


_AT = itemgetter(0)


class Seeds:
    """The seed of a run, and those that replace it from given times on."""

    def __init__(self, first: int, later: Iterable[tuple[float, int]] = ()) -> None:
        """later: times [s], increasing, each with the seed in force from then on."""
        self.first, self.later = first, tuple(later)

    def at(self, t: float) -> int:
        """Return the seed in force at t [s]."""
        count = bisect_right(self.later, t, key=_AT)
        return self.later[count - 1][1] if count else self.first


class Tables(dict[str, Draws]):
    """Tables of draws by purpose, whose rows are decided one after the other in time."""

    def __init__(self, seeds: Seeds | int, *purpose: str, width: int = 1) -> None:
        """Name the tables by what their purposes have in common; width: of their rows."""
        self._seeds = Seeds(seeds) if isinstance(seeds, int) else seeds
        self._purpose, self._width = purpose, width
        self._later: list[tuple[int, int]] = []

    def __missing__(self, purpose: str) -> Draws:
        """Make the table of one purpose, as far as it is decided."""
        name = (*self._purpose, purpose) if purpose else self._purpose
        draws = Draws(self._seeds.first, *name, width=self._width, later=self._later)
        self[purpose] = draws
        return draws

    def __call__(self) -> Draws:
        """Return the table of the purpose that all have in common."""
        return self[""]

    def decide(self, row: int, t: float) -> "Tables":
        """Return the tables, of which this row, and no later one, is decided at t [s]."""
        if self._seeds.later:
            for at, seed in self._seeds.later[len(self._later) :]:
                if t < at:
                    break
                self._later.append((row, seed))
                self.clear()
        return self


class SamplingClock:
    """One agent's perturbed clock, identical in the plant and in the agent."""

    def __init__(self, seeds: Seeds | int, agent: str, period: float, jitter: float) -> None:
        """Γ_i = period [s]; δ_i(k) uniform in ±jitter, with jitter = δ_i^max < period [s]."""
        self._period = period
        self._jitter = jitter
        self._tables = Tables(seeds, "clock", agent)

    def after(self, k: int, t: float, now: float = 0.0) -> float:
        """Return t_i^{k+1} [s], given that sample k was at t_i^k = t [s].

        now: when this is decided [s].
        """
        draws = self._tables.decide(k, now)()
        delta = self._jitter * (2.0 * draws.value(k) - 1.0)
        return t + self._period + delta

    def most_samples(self, duration: float) -> int:
        """Bound the number of samples in a run of this duration [s].

        Twice as many as fit, as a drift at most halves the period, and a thousand for live
        commands: an agent that is thawed samples at once, out of turn. Declared faults that have
        an agent do so are to be added.
        """
        return 1000 + 2 * math.ceil(duration / (self._period - self._jitter))
