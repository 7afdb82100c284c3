"""Encoding of the states that a sample carries: those of the agents in the receiver's sight."""

from functools import lru_cache

import numpy as np

from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index

_LAYOUTS = 64
"""Sets of agents in sight whose places are kept, at most."""


class StateCodec:
    """Packs states of some agents into bytes, and unpacks them."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._sizes = [part.stop - part.start for part in self._parts]
        self._unseen = np.full(self._parts[-1].stop, np.nan)
        self._places = lru_cache(_LAYOUTS)(self._find_places)

    def pack(self, x: Array, seen: tuple[int, ...]) -> bytes:
        """Pack these agents' parts of the stacked state x, shape (n̄,), as little-endian float64."""
        return x[self._places(seen)].astype("<f8").tobytes()

    def unpack(self, packed: bytes, seen: tuple[int, ...]) -> Array:
        """Return the stacked state, shape (n̄,), with NaN for agents that are not seen.

        Raises ValueError unless `seen` is in order and `packed` has the size of these states.
        """
        places = self._places(seen)
        if len(packed) != 8 * places.size:
            raise ValueError(f"expected {places.size} numbers, got {len(packed)} bytes")
        x = self._unseen.copy()
        x[places] = np.frombuffer(packed, dtype="<f8")
        return x

    def _find_places(self, seen: tuple[int, ...]) -> Index:
        """Return the places of these agents' states in the stacked state."""
        if any(a >= b for a, b in zip((-1, *seen), (*seen, len(self._parts)), strict=True)):
            raise ValueError("expected members in order")
        every = np.arange(self._unseen.size)
        return np.concatenate([every[:0], *[every[self._parts[l]] for l in seen]])

    def unpack_one(self, i: int, packed: bytes, seen: tuple[int, ...]) -> Array:
        """Return the state of agent i, which is in `seen`, shape (n_i,)."""
        begin = sum(self._sizes[l] for l in seen[: seen.index(i)])
        return np.frombuffer(packed, dtype="<f8", count=self._sizes[i], offset=8 * begin)
