"""The part of the stacked state that an agent sees, as it is handed to it and taken apart again."""

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm


class SeenStates:
    """Packs the states of those seen, and lays them out again in the stack of all."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._sizes = [part.stop - part.start for part in self._parts]

    def packed(self, x: Array, seen: tuple[int, ...]) -> bytes:
        """Their states out of the stacked state x, shape (n̄,), as little-endian float64."""
        if len(seen) == len(self._parts):
            return x.astype("<f8").tobytes()
        return np.concatenate([x[self._parts[l]] for l in seen]).astype("<f8").tobytes()

    def of(self, packed: bytes, seen: tuple[int, ...]) -> dict[int, Array]:
        """The states by member.

        Raises ValueError unless `seen` are members, in order, and `packed` is as long as they are.
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

    def one(self, i: int, packed: bytes, seen: tuple[int, ...]) -> Array:
        """The state of member i, which is among those seen, shape (n_i,)."""
        begin = sum(self._sizes[l] for l in seen[: seen.index(i)])
        return np.frombuffer(packed, dtype="<f8", count=self._sizes[i], offset=8 * begin)

    def stacked(self, states: dict[int, Array]) -> Array:
        """The stacked state, shape (n̄,): NaN for who is not seen, which nobody can use unawares."""
        x = np.full(self._parts[-1].stop, np.nan)
        for l, state in states.items():
            x[self._parts[l]] = state
        return x
