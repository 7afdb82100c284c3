"""Encoding of the states that a sample carries: those of the agents in the receiver's sight."""

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm


class StateCodec:
    """Packs states of some agents into bytes, and unpacks them."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._sizes = [part.stop - part.start for part in self._parts]

    def pack(self, x: Array, seen: tuple[int, ...]) -> bytes:
        """Pack these agents' parts of the stacked state x, shape (n̄,), as little-endian float64."""
        if len(seen) == len(self._parts):
            return x.astype("<f8").tobytes()
        return np.concatenate([x[self._parts[l]] for l in seen]).astype("<f8").tobytes()

    def unpack(self, packed: bytes, seen: tuple[int, ...]) -> dict[int, Array]:
        """Return each agent's state.

        Raises ValueError unless `seen` is in order and `packed` has the size of these states.
        """
        if any(a >= b for a, b in zip((-1, *seen), (*seen, len(self._parts)), strict=True)):
            raise ValueError("expected members in order")
        if len(packed) % 8:
            raise ValueError("expected whole numbers of 8 bytes")
        values, states, begin = np.frombuffer(packed, dtype="<f8"), {}, 0
        for l in seen:
            end = begin + self._sizes[l]
            states[l], begin = values[begin:end], end
        if begin != len(values):
            raise ValueError(f"expected {begin} numbers, got {len(values)}")
        return states

    def unpack_one(self, i: int, packed: bytes, seen: tuple[int, ...]) -> Array:
        """Return the state of agent i, which is in `seen`, shape (n_i,)."""
        begin = sum(self._sizes[l] for l in seen[: seen.index(i)])
        return np.frombuffer(packed, dtype="<f8", count=self._sizes[i], offset=8 * begin)

    def stack(self, states: dict[int, Array]) -> Array:
        """Return the stacked state, shape (n̄,), with NaN for agents that are not seen."""
        x = np.full(self._parts[-1].stop, np.nan)
        for l, state in states.items():
            x[self._parts[l]] = state
        return x
