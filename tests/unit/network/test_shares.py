"""Shares of 40 000 messages that rules treat, and lengths of their runs."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import chisquare

from phalanx.network.link import Delivery, Link
from tests.unit.network.models import MANY, model
from tests.unit.network.test_loss import chi_square_of_geometric, runs

SHARE = 0.2
COMBINED_WITH = {"reorder": {"delay": 0.01}}
"""Without a delay nothing could be reordered."""
AFFECTED: dict[str, Callable[[Delivery], bool]] = {
    "corrupt": lambda delivery: delivery.delay is None,
    "duplicate": lambda delivery: len(delivery.copies) == 2,
    "reorder": lambda delivery: delivery.delay == 0.0,
}


def befallen(field: str, **table: float) -> np.ndarray:
    """Return for each message whether the rule treated it, shape (MANY,)."""
    fields = {field: {"probability": SHARE, **table}, **COMBINED_WITH.get(field, {})}
    link = Link(0, "a", "b", model(**fields))
    return np.array([AFFECTED[field](link.fate(k)) for k in range(MANY)])


@pytest.mark.slow
@pytest.mark.parametrize("field", AFFECTED)
def test_without_correlation_no_message_knows_of_another(field):
    hits = befallen(field)
    assert np.mean(hits) == pytest.approx(SHARE, abs=4.0 * np.sqrt(SHARE * (1 - SHARE) / MANY))
    assert chi_square_of_geometric(runs(hits), SHARE) > 0.01
    pairs = np.bincount(2 * hits[:-1:2] + hits[1::2], minlength=4)
    expected = np.outer([1 - SHARE, SHARE], [1 - SHARE, SHARE]).ravel() * (MANY // 2)
    assert chisquare(pairs, expected).pvalue > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("field", "correlation"), [("corrupt", 0.3), ("duplicate", 0.8), ("reorder", 0.5)]
)
def test_a_correlation_makes_runs_and_leaves_the_share_as_it_is(field, correlation):
    hits = befallen(field, correlation=correlation)
    effective = MANY * (1.0 - correlation) / (1.0 + correlation)
    assert np.mean(hits) == pytest.approx(SHARE, abs=4.0 * np.sqrt(SHARE * (1 - SHARE) / effective))
    assert chi_square_of_geometric(runs(hits), correlation + (1.0 - correlation) * SHARE) > 0.01
    for ahead in (1, 2):
        expected = correlation**ahead
        measured = np.corrcoef(hits[ahead:], hits[:-ahead])[0, 1]
        assert measured == pytest.approx(expected, abs=5.0 / np.sqrt(effective))
