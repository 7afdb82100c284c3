"""Delays and losses that were measured: each message has those of a packet at its time."""

import csv
import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Len

from phalanx.network.rule import DROP, Message, Treatment, delay
from phalanx.schema.fields import Finite

_MOST = 2000
"""Most packets: a message to each viewer has all of them."""
_LOST = -1.0
_DIGITS = 6
"""Of times and delays: whole microseconds."""


class TraceFileError(ValueError):
    """A file that is no trace; the message has file, line, column, expected and got."""


@dataclass(frozen=True)
class Trace:
    """Packets that were measured; the run begins with the first, and after the last so does it.

    >>> Trace(t=(0.0, 0.1), delay=(0.02, -1.0)).period
    0.2
    """

    t: Annotated[tuple[Finite, ...], Len(2, _MOST)]
    """When each was sent, from 0 on [s]; in a scenario file a path stands for the table."""
    delay: tuple[Finite, ...]
    """Of each [s]; negative: lost."""

    def __post_init__(self) -> None:
        if len(self.t) != len(self.delay):
            raise ValueError(f"expected {len(self.t)} delays, as times, got {len(self.delay)}")
        if self.t[0] != 0.0 or sorted(set(self.t)) != list(self.t):
            raise ValueError("expected times that rise from 0 on")

    @property
    def period(self) -> float:
        """Time after which it begins again [s]: the last packet counts for the mean spacing."""
        return self.t[-1] * len(self.t) / (len(self.t) - 1)

    def __str__(self) -> str:
        lost = sum(after < 0.0 for after in self.delay)
        return f"{len(self.t)} packets of {self.t[-1]:.4g} s, {lost} lost"

    def treat(self, message: Message) -> Treatment:
        """Treat a message as the last packet at or before its time."""
        after = self.delay[bisect_right(self.t, message.t % self.period) - 1]
        return DROP if after < 0.0 else delay(after)


def with_traces(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Put into a scenario's table, in place, the traces whose paths it names; return it.

    folder: to which paths are relative. Raises TraceFileError.
    """
    for links in _link_tables(table):
        if isinstance(name := links.get("trace"), str):
            links["trace"] = _read(folder / name)
    return table


def _link_tables(table: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield all tables of links and faults of a scenario, which may not be valid."""
    network = table.get("network")
    if isinstance(network, dict):
        yield network
        yield from (t for t in network.values() if isinstance(t, dict))
    for listed in (network.get("links") if isinstance(network, dict) else (), table.get("faults")):
        if isinstance(listed, list | tuple):
            yield from (each for each in listed if isinstance(each, dict))


def _read(path: Path) -> dict[str, list[float]]:
    """Read columns t and delay [s] of a CSV; an empty delay is a lost packet."""
    times, delays = list[float](), list[float]()
    try:
        if not path.is_file():
            raise TraceFileError(f"{path}: expected a CSV file, got none")
        with path.open(encoding="utf-8", newline="") as lines:
            reader = csv.DictReader(lines)
            if not {"t", "delay"} <= {*(reader.fieldnames or ())}:
                names = reader.fieldnames
                raise TraceFileError(f"{path}, line 1: expected columns t and delay, got {names}")
            for row in islice(reader, _MOST + 1):
                where = f"{path}, line {reader.line_num}"
                times.append(round(_seconds(row["t"], f"{where}, t"), _DIGITS))
                delays.append(round(_seconds(row["delay"], f"{where}, delay", _LOST), _DIGITS))
                if len(times) > 1 and times[-1] <= times[-2]:
                    raise TraceFileError(
                        f"{where}, t: expected more than {times[-2]}, got {times[-1]}"
                    )
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TraceFileError(f"{path}: cannot be read: {error}") from error
    if not 2 <= len(times) <= _MOST:
        raise TraceFileError(f"{path}: expected 2 to {_MOST} packets, got {len(times)}")
    return {"t": [round(t - times[0], _DIGITS) for t in times], "delay": delays}


def _seconds(text: str | None, where: str, empty: float | None = None) -> float:
    """Return a time; empty: what no text means, if it may be empty."""
    text = (text or "").strip()
    if not text and empty is not None:
        return empty
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 <= number < math.inf:
        nothing = "" if empty is None else " or nothing"
        raise TraceFileError(f"{where}: expected seconds{nothing}, got {text!r}")
    return number
