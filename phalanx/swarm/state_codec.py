"""Encoding of the states that a sample carries: those of the agents in the receiver's sight."""

from functools import lru_cache
from itertools import accumulate

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm

_LAYOUTS = 64
"""Sets of agents in sight whose layout is kept, at most."""


class StateCodec:
    """Packs states of some agents into bytes, and unpacks them."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._sizes = [part.stop - part.start for part in self._parts]
        self._unseen = np.full(self._parts[-1].stop, np.nan)
        self._layout = lru_cache(_LAYOUTS)(self._find_layout)

    def pack(self, x: Array, seen: tuple[int, ...]) -> bytes:
        """Pack these agents' parts of the stacked state x, shape (n̄,), as little-endian float64."""
        if len(seen) == len(self._parts):
            return x.astype("<f8").tobytes()
        return np.concatenate([x[self._parts[l]] for l in seen]).astype("<f8").tobytes()

    def unpack(self, packed: bytes, seen: tuple[int, ...]) -> dict[int, Array]:
        """Return each agent's state.

        Raises ValueError unless `seen` is in order and `packed` has the size of these states.
        """
        parts, size = self._layout(seen)
        if len(packed) != 8 * size:
            raise ValueError(f"expected {size} numbers, got {len(packed)} bytes")
        values = np.frombuffer(packed, dtype="<f8")
        return {l: values[part] for l, part in parts}

    def _find_layout(self, seen: tuple[int, ...]) -> tuple[list[tuple[int, slice]], int]:
        """Return each agent's slice of the packed states, and their number."""
        if any(a >= b for a, b in zip((-1, *seen), (*seen, len(self._parts)), strict=True)):
            raise ValueError("expected members in order")
        ends = list(accumulate((self._sizes[l] for l in seen), initial=0))
        return list(zip(seen, map(slice, ends, ends[1:]), strict=True)), ends[-1]

    def unpack_one(self, i: int, packed: bytes, seen: tuple[int, ...]) -> Array:
        """Return the state of agent i, which is in `seen`, shape (n_i,)."""
        begin = sum(self._sizes[l] for l in seen[: seen.index(i)])
        return np.frombuffer(packed, dtype="<f8", count=self._sizes[i], offset=8 * begin)

    def stack(self, states: dict[int, Array]) -> Array:
        """Return the stacked state, shape (n̄,), with NaN for agents that are not seen."""
        x = self._unseen.copy()
        for l, state in states.items():
            x[self._parts[l]] = state
        return x
