"""A link model from what was measured: delays of messages in their order, and which were lost."""

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from phalanx.network.distributions import Distribution, quantile

Array = NDArray[np.float64]

_FEW = 30
"""Messages that are too few to fit anything to."""
_SIGNIFICANT = 3.0
"""Standard deviations from which on something is not chance."""
_CONSTANT = 1e-3
"""A spread below this share of the mean is none."""


class CaptureError(ValueError):
    """A capture that cannot be fitted; the message says which line, and what was expected."""


@dataclass(frozen=True)
class FittedLink:
    """A link model, and how well it fits."""

    table: Mapping[str, Any]
    """Fields of [network]."""
    messages: int
    lost: int
    distance: float
    """Kolmogorov and Smirnov's, of the measured delays and the model's."""


def read_capture(lines: Iterable[str]) -> Array:
    """Delays [s] of a CSV's column `delay`; not a number where it is empty: lost.

    Raises:
        CaptureError: no such column, too few lines, or a delay that is none.
    """
    reader = csv.DictReader(lines)
    if "delay" not in (reader.fieldnames or ()):
        raise CaptureError(f"line 1: expected a column delay, got {reader.fieldnames}")
    delays = np.array([_delay(row["delay"], reader.line_num) for row in reader])
    if np.count_nonzero(np.isfinite(delays)) < _FEW:
        raise CaptureError(f"expected at least {_FEW} messages that were not lost")
    return delays


def fit(delays: Array) -> FittedLink:
    """The model of [network] that fits delays [s] best; those not a number were lost."""
    lost = np.isnan(delays)
    arrived = np.sort(delays[~lost])
    table: dict[str, Any] = {}
    if arrived.std() <= _CONSTANT * arrived.mean():
        table["delay"], distance = _rounded(arrived.mean()), 0.0
    else:
        found = [_fitted(arrived, kind) for kind in get_args(Distribution)]
        distance, table["delay"] = min(found, key=lambda each: each[0])
        if kept := _correlation(delays):
            table["delay"]["correlation"] = kept
    if lost.any():
        table["loss"] = _loss(lost)
    return FittedLink(table, len(delays), int(lost.sum()), distance)


def _fitted(arrived: Array, kind: Distribution) -> tuple[float, dict[str, Any]]:
    """How far a distribution is off, and the time and jitter at which it is least so."""
    places = (np.arange(len(arrived)) + 0.5) / len(arrived)
    scaled = np.array([quantile(kind, u) for u in places.tolist()])
    jitter, time = (max(0.0, float(c)) for c in np.polyfit(scaled, arrived, 1))
    # The share of the model's delays below each measured one, against that of the measured.
    below = np.searchsorted(np.maximum(0.0, time + jitter * scaled), arrived) / len(arrived)
    distance = float(np.abs(below - places).max())
    return distance, {"time": _rounded(time), "jitter": _rounded(jitter), "distribution": kind}


def _correlation(delays: Array) -> float:
    """Of one message's delay and the next one's, where both arrived; 0 if it may be chance."""
    one, next_one = delays[:-1], delays[1:]
    both = np.isfinite(one) & np.isfinite(next_one)
    if np.count_nonzero(both) < _FEW:
        return 0.0
    found = float(np.corrcoef(one[both], next_one[both])[0, 1])
    chance = _SIGNIFICANT / math.sqrt(np.count_nonzero(both))
    return _rounded(min(found, 0.99)) if found > chance else 0.0


def _loss(lost: NDArray[np.bool_]) -> float | dict[str, float]:
    """The share lost; with the mean burst, if bursts are longer than chance would have them."""
    mean = float(lost.mean())
    bursts = np.count_nonzero(lost[1:] & ~lost[:-1]) + int(lost[0])
    burst = lost.sum() / bursts
    if mean < 1.0:
        by_chance = 1.0 / (1.0 - mean)
        spread = math.sqrt(mean) * by_chance / math.sqrt(bursts)
        if burst - by_chance > _SIGNIFICANT * spread:
            return {"mean": _rounded(mean), "burst": _rounded(float(burst))}
    return _rounded(mean)


def _delay(text: str | None, line: int) -> float:
    if not (text or "").strip():
        return math.nan
    try:
        delay = float(text or "")
    except ValueError:
        delay = -1.0
    if not 0.0 <= delay < math.inf:
        raise CaptureError(f"line {line}: expected a delay in seconds or nothing, got {text!r}")
    return delay


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
