"""The trajectory's hash: one number that tells whether two runs were the same to the last bit."""

import hashlib

import numpy as np

from phalanx_plant.events.events import InputApplied, StateReached


class TrajectoryHash:
    """SHA-256 over every state at an event and every applied input, in order."""

    def __init__(self) -> None:
        self._sha = hashlib.sha256()

    def add(self, event: StateReached | InputApplied) -> None:
        """Take the next event."""
        if isinstance(event, StateReached):
            self._sha.update(np.float64(event.t).tobytes() + event.x.tobytes())
        else:
            self._sha.update(np.array([event.i, event.k, *event.u]).tobytes())

    @property
    def hexadecimal(self) -> str:
        """Of all events so far."""
        return self._sha.hexdigest()
