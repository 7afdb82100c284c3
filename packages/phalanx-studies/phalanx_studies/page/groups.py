"""The rows of a study in groups: by the values of an axis, with the rate of each outcome."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from phalanx.guarantee.verdict import Outcome
from phalanx_studies.statistics import Rate, rate

MOST_GROUPS = 12
"""Most values of an axis that are shown one by one."""
_BINS = 8
_OTHERS = "others"
_NOT_SET = "not set"


class Group(NamedTuple):
    """The runs at one value of an axis, or in a range of its values."""

    label: str
    rows: pl.DataFrame
    rates: Mapping[str, Rate]
    """By outcome."""


def group(label: str, rows: pl.DataFrame) -> Group:
    """Return runs that count as a group, with the rate of each outcome."""
    seeds = rows["seed"].to_numpy()
    rates = {o.value: rate((rows["outcome"] == o).to_numpy(), seeds) for o in Outcome}
    return Group(label, rows, rates)


def by_axis(runs: pl.DataFrame, axis: str) -> list[Group]:
    """Return the groups of an axis in its order."""
    names, of_row = labels(runs[axis])
    return [group(name, runs.filter(of_row == i)) for i, name in enumerate(names)]


def labels(values: pl.Series) -> tuple[list[str], pl.Series]:
    """Return the names of an axis' groups in its order, and for each row the number of its group.

    Numbers are in ascending order, and many of them in ranges that hold as many rows each. Texts
    are in the order of their first row; of many, the rarer ones are one group.
    """
    several = values.unique(maintain_order=True)
    if len(several) > MOST_GROUPS and values.dtype.is_numeric():
        return _ranges(values)
    if len(several) > MOST_GROUPS:
        several = values.value_counts(sort=True)[values.name].head(MOST_GROUPS - 1)
    elif values.dtype.is_numeric():
        several = several.sort()
    number = {value: i for i, value in enumerate(several)}
    names = [in_words(value) for value in several]
    of_row = pl.Series([number.get(value, len(number)) for value in values], dtype=pl.Int64)
    return ([*names, _OTHERS] if (of_row == len(number)).any() else names), of_row


def in_words(value: Any) -> str:
    """Return a value of an axis as text."""
    if value is None:
        return _NOT_SET
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def in_percent(share: float) -> str:
    """Return a share as text in percent, without the sign."""
    return f"{round(100.0 * share, 2):.3g}"


def _ranges(values: pl.Series) -> tuple[list[str], pl.Series]:
    present = values.drop_nulls().to_numpy()
    edges = np.unique(np.quantile(present, np.linspace(0.0, 1.0, _BINS + 1)))
    names = [f"{low:.3g} to {high:.3g}" for low, high in pairwise(edges)]
    numbers = np.searchsorted(edges[1:-1], values.to_numpy(), side="right")
    absent = values.is_null().to_numpy()
    of_row = pl.Series(np.where(absent, len(names), numbers), dtype=pl.Int64)
    return ([*names, _NOT_SET] if absent.any() else names), of_row


def outcomes_of(groups: Sequence[Group]) -> list[str]:
    """Return the outcomes to show: those that some run had, and in any case "violated"."""
    return [
        outcome.value
        for outcome in Outcome
        if outcome is Outcome.VIOLATED or any(group.rates[outcome].share for group in groups)
    ]
