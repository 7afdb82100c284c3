"""Counter-based randomness: every draw is a pure function of (seed, purpose, index).

Neither call order nor time nor the process that asks matters: the plant, an agent and a report
that ask for the same draw get the same bits.
"""

import hashlib
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLOCK = 256


class Draws:
    """An endless table of uniform draws in [0, 1): row `index` holds `width` of them."""

    def __init__(self, seed: int, *purpose: str, width: int = 1) -> None:
        """Name the table by seed and purpose, for example (0, "jitter", "agent-1")."""
        name = "\x1f".join([str(seed), *purpose]).encode()
        self._key = int.from_bytes(hashlib.blake2b(name, digest_size=16).digest(), "little")
        self._width = width
        self._block = lru_cache(maxsize=8)(self._generate)

    def __getitem__(self, index: int) -> Array:
        """Row `index` >= 0, shape (width,). Do not write to it."""
        block, row = divmod(index, _BLOCK)
        draws: Array = self._block(block)[row]
        return draws

    def last(self, index: int, holds: Callable[[Array], NDArray[np.bool_]]) -> int:
        """The last row up to `index` of which something holds; 0 if it holds of none.

        holds: of rows, shape (r, width), which they are, shape (r,).
        """
        block, row = divmod(index, _BLOCK)
        (found,) = holds(self._block(block)[: row + 1]).nonzero()
        while not len(found) and block:
            block -= 1
            (found,) = holds(self._block(block)).nonzero()
        return block * _BLOCK + int(found[-1]) if len(found) else 0

    def _generate(self, block: int) -> Array:
        # The block number is the counter's high word, so blocks never overlap.
        generator = np.random.Generator(np.random.Philox(key=self._key, counter=block << 192))
        return generator.random((_BLOCK, self._width))
