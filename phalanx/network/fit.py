"""Fit of a link model to measured delays and losses."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from phalanx.network.delay import Distribution, quantile
from phalanx.theory.arrays import Array, Mask

Unit = Literal["s", "ms", "us"]
_SECONDS: Mapping[Unit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_IMPLAUSIBLE = 1.0
"""Networks of robots are faster: a median delay above it [s] is probably in another unit."""
_FEW = 30
"""Least number of messages for a fit."""
_SIGNIFICANT = 3.0
"""Standard deviations from which on an effect is significant."""
_CONSTANT = 1e-3
"""A delay with a smaller relative spread counts as constant."""


class CaptureError(ValueError):
    """A capture that cannot be fitted; the message has the line and the expected content."""


@dataclass(frozen=True)
class FittedLink:
    """A link model and the quality of its fit."""

    table: Mapping[str, Any]
    """Fields of [network]."""
    messages: int
    lost: int
    median: float
    """Median delay [s]."""
    distance: float
    """Kolmogorov-Smirnov distance of the measured delays and the model's."""


def read_capture(lines: Iterable[str], unit: Unit | None = None) -> Array:
    """Read the delays [s] of a CSV's column `delay`; an empty field (NaN) is a lost message.

    Args:
        lines: of the file. If `delay` is the only column, an empty line is a lost message.
        unit: of the delays; default: seconds, if plausible.

    Raises:
        CaptureError: no such column, too few lines, a malformed delay, or delays too long to be in
            seconds.
    """
    reader = csv.reader(lines)
    head = next(reader, [])
    if "delay" not in head:
        raise CaptureError(f"line 1: expected a column delay, got {head}")
    column, only = head.index("delay"), len(head) == 1
    read = [_delay(row[column:], reader.line_num) for row in reader if row or only]
    delays = _SECONDS[unit or "s"] * np.array(read)
    if np.count_nonzero(np.isfinite(delays)) < _FEW:
        raise CaptureError(f"expected at least {_FEW} messages that were not lost")
    median = np.nanmedian(delays)
    if unit is None and median > _IMPLAUSIBLE:
        raise CaptureError(
            f"half of the delays are above {median:.4g} s: give their unit, --unit ms or s"
        )
    return delays


def fit(delays: Array) -> FittedLink:
    """Fit the fields of [network] to delays [s], with NaN for lost messages."""
    lost = np.isnan(delays)
    arrived = np.sort(delays[~lost])
    table: dict[str, Any] = {}
    if arrived.std() <= _CONSTANT * arrived.mean():
        table["delay"], distance = _rounded(arrived.mean()), 0.0
    else:
        fits = [_fitted(arrived, kind) for kind in get_args(Distribution)]
        distance, table["delay"] = min(fits, key=lambda candidate: candidate[0])
        if correlation := _correlation(delays):
            table["delay"]["correlation"] = correlation
    if lost.any():
        table["loss"] = _loss(lost)
    return FittedLink(table, len(delays), int(lost.sum()), float(np.median(arrived)), distance)


def _fitted(arrived: Array, kind: Distribution) -> tuple[float, dict[str, Any]]:
    """Fit time and jitter of one distribution; return the distance and the fields of `delay`."""
    shares = (np.arange(len(arrived)) + 0.5) / len(arrived)
    scaled = np.array([quantile(kind, u) for u in shares.tolist()])
    jitter, time = (max(0.0, float(c)) for c in np.polyfit(scaled, arrived, 1))
    # The model's share of delays below each measured one, compared with the measured share.
    below = np.searchsorted(np.maximum(0.0, time + jitter * scaled), arrived) / len(arrived)
    distance = float(np.abs(below - shares).max())
    return distance, {"time": _rounded(time), "jitter": _rounded(jitter), "distribution": kind}


def _correlation(delays: Array) -> float:
    """Return the correlation of consecutive delays; 0 if it is not significant."""
    delay, next_one = delays[:-1], delays[1:]
    both = np.isfinite(delay) & np.isfinite(next_one)
    if np.count_nonzero(both) < _FEW:
        return 0.0
    correlation = float(np.corrcoef(delay[both], next_one[both])[0, 1])
    chance = _SIGNIFICANT / math.sqrt(np.count_nonzero(both))
    return _rounded(min(correlation, 0.99)) if correlation > chance else 0.0


def _loss(lost: Mask) -> float | dict[str, float]:
    """Return the share lost; with the mean burst, if it is longer than by chance."""
    mean = float(lost.mean())
    bursts = np.count_nonzero(lost[1:] & ~lost[:-1]) + int(lost[0])
    burst = lost.sum() / bursts
    if mean < 1.0:
        by_chance = 1.0 / (1.0 - mean)
        spread = math.sqrt(mean) * by_chance / math.sqrt(bursts)
        if burst - by_chance > _SIGNIFICANT * spread:
            return {"mean": _rounded(mean), "burst": _rounded(float(burst))}
    return _rounded(mean)


def _delay(cells: Sequence[str], line: int) -> float:
    """Return the number in the first cell; NaN if the cell is empty or missing."""
    text = "".join(cells[:1]).strip()
    if not text:
        return math.nan
    try:
        delay = float(text)
    except ValueError:
        delay = -1.0
    if not 0.0 <= delay < math.inf:
        raise CaptureError(f"line {line}: expected a delay or nothing, got {text!r}")
    return delay


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
