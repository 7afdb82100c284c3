"""Rules over 40 000 messages: shares, bursts and correlation as asked for."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare

from phalanx.network.link import Delivery, Link
from tests.unit.network.models import MANY, SOME, lost, model


def runs(of: np.ndarray) -> np.ndarray:
    """Lengths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], of.astype(int), [0]])))
    return edges[1::2] - edges[::2]


def chi_square_of_geometric(lengths: np.ndarray, stay: float) -> float:
    """Return the p-value of lengths for a geometric distribution; bins have at least twenty."""
    longest = max(2, int(np.floor(np.log(20.0 / len(lengths)) / np.log(stay))))
    shares = [(1.0 - stay) * stay ** (n - 1) for n in range(1, longest)]
    shares.append(1.0 - sum(shares))
    counts = np.bincount(np.minimum(lengths, longest), minlength=longest + 1)[1:]
    return float(chisquare(counts, np.array(shares) * len(lengths)).pvalue)


SHARE = 0.2
AFFECTED: dict[str, Callable[[Delivery], bool]] = {
    "loss": lambda delivery: delivery.delay is None,
    "corrupt": lambda delivery: delivery.delay is None,
    "duplicate": lambda delivery: len(delivery.copies) == 2,
    "reorder": lambda delivery: delivery.delay == 0.0,
}


def treated(field: str) -> np.ndarray:
    """Return for each message whether the rule treated it, shape (MANY,)."""
    fields: dict[str, object] = {field: SHARE}
    if field == "reorder":  # without a delay nothing could be
        fields = {field: {"probability": SHARE}, "delay": 0.01}
    link = Link(0, "a", "b", model(**fields))
    return np.array([AFFECTED[field](link.fate(k)) for k in range(MANY)])


@pytest.mark.slow
@pytest.mark.parametrize("field", AFFECTED)
def test_without_correlation_no_message_knows_of_another(field):
    hits = treated(field)
    assert np.mean(hits) == pytest.approx(SHARE, abs=4.0 * np.sqrt(SHARE * (1 - SHARE) / MANY))
    assert chi_square_of_geometric(runs(hits), SHARE) > 0.01
    pairs = np.bincount(2 * hits[:-1:2] + hits[1::2], minlength=4)
    expected = np.outer([1 - SHARE, SHARE], [1 - SHARE, SHARE]).ravel() * (MANY // 2)
    assert chisquare(pairs, expected).pvalue > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("mean", "burst"), [(0.1, 4.0), (0.7, 25.0), (0.5, 1.2)])
def test_bursts_are_as_long_as_asked_for_and_the_share_is_kept(mean, burst):
    gone = lost(loss={"mean": mean, "burst": burst})
    stay = 1.0 - 1.0 / burst
    correlation = stay - mean / burst / (1.0 - mean)  # 1 - p - r: the correlation of the chain
    effective = MANY * (1.0 - correlation) / (1.0 + correlation)
    assert np.mean(gone) == pytest.approx(mean, abs=4.0 * np.sqrt(mean * (1 - mean) / effective))
    lengths = runs(gone)
    assert np.mean(lengths) == pytest.approx(burst, abs=4.0 * burst / np.sqrt(len(lengths)))
    assert chi_square_of_geometric(lengths, stay) > 0.01


def test_a_link_that_changes_more_often_than_not_alternates():
    mean, burst = 0.53, 1.2
    gone = lost(SOME, loss={"mean": mean, "burst": burst})
    stay = 1.0 - 1.0 / burst - mean / burst / (1.0 - mean)  # below 0
    assert np.mean(gone) == pytest.approx(mean, abs=0.005)
    assert np.corrcoef(gone[1:], gone[:-1])[0, 1] == pytest.approx(stay, abs=0.02)


BURSTY = model(
    loss={"mean": 0.2, "burst": 10.0},
    delay={"time": 0.1, "jitter": 0.02, "correlation": 0.8, "distribution": "paretonormal"},
    duplicate=0.1,
)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.permutations(range(300, 700, 7)))
def test_bursts_and_correlation_do_not_depend_on_the_order_of_asking(order):
    straight = Link(3, "a", "b", BURSTY)
    once = {k: straight.fate(k) for k in range(700)}
    other = Link(3, "a", "b", BURSTY)
    assert {k: other.fate(k) for k in order} == {k: once[k] for k in order}


def test_loss_by_distance_is_none_near_all_far_and_linear_between():
    link = Link(0, "a", "b", model(loss_by_distance={"none_within": 10.0, "all_beyond": 30.0}))
    metres = np.array([0.0, 10.0, 12.0, 15.0, 20.0, 25.0, 28.0, 30.0, 99.0])
    shares = np.clip((metres - 10.0) / 20.0, 0.0, 1.0)
    group_size = MANY // len(metres)
    gone = [link.fate(k, distance=metres[k % len(metres)]).delay is None for k in range(MANY)]
    counted = np.array(gone[: group_size * len(metres)]).reshape(group_size, -1).sum(axis=0)
    assert counted[shares == 0.0].sum() == 0
    assert (counted[shares == 1.0] == group_size).all()
    between = (shares > 0.0) & (shares < 1.0)
    counts = np.concatenate([counted[between], group_size - counted[between]])
    expected = np.concatenate([shares[between], 1.0 - shares[between]]) * group_size
    assert chisquare(counts, expected, ddof=between.sum() - 1).pvalue > 0.01
    assert link.asks_distance
