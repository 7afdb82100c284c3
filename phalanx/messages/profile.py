"""A stopwatch for the phases of a program: how much of its wall time each call takes."""

import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import msgspec


class TimeSpent(msgspec.Struct):
    """The wall time of one program of a run."""

    program: str
    wall: float
    """From its first timed call to the end of its last [s]."""
    phases: dict[str, float]
    """Time in each phase [s]; the rest of the wall time is in none."""
    calls: dict[str, int]
    """Timed calls of each phase."""


class Stopwatch:
    """Adds up the time of chosen calls; that of nested timed calls counts for the inner ones alone.

    Chosen methods are wrapped, and others cost nothing. All timed calls of one stopwatch must come
    from one thread at a time.
    """

    def __init__(self) -> None:
        self._seconds: dict[str, float] = defaultdict(float)
        self._calls: dict[str, int] = defaultdict(int)
        self._inner = 0.0
        """Time in timed calls within the present one [s]."""
        self._began: float | None = None
        self._ended = 0.0

    def time(self, owner: object, call: str, phase: str) -> None:
        """Add the time of an object's method to a phase from now on."""
        timed = getattr(owner, call)

        def stamped(*arguments: Any, **named: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            began = time.perf_counter()
            if self._began is None:
                self._began = began
            try:
                return timed(*arguments, **named)
            finally:
                self._ended = time.perf_counter()
                took = self._ended - began
                self._seconds[phase] += took - self._inner
                self._calls[phase] += 1
                self._inner = outer + took

        setattr(owner, call, stamped)

    def spent(self, program: str) -> TimeSpent:
        """Return the times so far."""
        began = self._ended if self._began is None else self._began
        return TimeSpent(program, self._ended - began, dict(self._seconds), dict(self._calls))

    def write(self, folder: Path, program: str) -> None:
        """Write the times into a folder. Raises OSError."""
        folder.mkdir(exist_ok=True)
        (folder / f"{program}.json").write_bytes(msgspec.json.encode(self.spent(program)))


def read_profile(folder: Path) -> list[TimeSpent]:
    """Read the times of a run's programs from a folder; none if it does not exist."""
    files = sorted(filter(Path.is_file, folder.glob("*.json")))
    return [msgspec.json.decode(file.read_bytes(), type=TimeSpent) for file in files]
