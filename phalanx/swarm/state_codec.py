"""Encoding of the states that a sample carries: those of the agents in the receiver's sight."""

from functools import lru_cache

import numpy as np

from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index

_LAYOUTS = 64
"""Sets of agents in sight whose indices are cached, at most."""


class StateCodec:
    """Packs states of some agents into bytes, and unpacks them."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._sizes = [part.stop - part.start for part in self._parts]
        self._unseen = np.full(self._parts[-1].stop, np.nan)
        self._indices = lru_cache(_LAYOUTS)(self._find_indices)

    def pack(self, x: Array, in_sight: tuple[int, ...]) -> bytes:
        """Pack these agents' parts of the stacked state x, shape (n̄,), as little-endian float64."""
        return x[self._indices(in_sight)].astype("<f8").tobytes()

    def unpack(self, packed: bytes, in_sight: tuple[int, ...]) -> Array:
        """Return the stacked state, shape (n̄,), with NaN for agents out of sight.

        Raises ValueError unless `in_sight` is in order and `packed` has the size of these states.
        """
        indices = self._indices(in_sight)
        if len(packed) != 8 * indices.size:
            raise ValueError(f"expected {indices.size} numbers, got {len(packed)} bytes")
        x = self._unseen.copy()
        x[indices] = np.frombuffer(packed, dtype="<f8")
        return x

    def _find_indices(self, in_sight: tuple[int, ...]) -> Index:
        """Return the indices of these agents' states in the stacked state."""
        if any(a >= b for a, b in zip((-1, *in_sight), (*in_sight, len(self._parts)), strict=True)):
            raise ValueError("expected members in order")
        every = np.arange(self._unseen.size)
        return np.concatenate([every[:0], *[every[self._parts[l]] for l in in_sight]])

    def unpack_one(self, i: int, packed: bytes, in_sight: tuple[int, ...]) -> Array:
        """Return the state of agent i, which is in sight, shape (n_i,)."""
        begin = sum(self._sizes[l] for l in in_sight[: in_sight.index(i)])
        return np.frombuffer(packed, dtype="<f8", count=self._sizes[i], offset=8 * begin)
