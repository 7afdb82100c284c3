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


def treated(field: str, correlation: float = 0.0) -> np.ndarray:
    """Return for each message whether the rule treated it, shape (MANY,)."""
    chance = "random" if field == "loss" else "probability"
    fields: dict[str, object] = {field: {chance: SHARE, "correlation": correlation}}
    if field == "reorder":  # without a delay nothing could be
        fields["delay"] = 0.01
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
@pytest.mark.parametrize(
    ("field", "correlation"),
    [("loss", 0.25), ("loss", 0.8), ("corrupt", 0.3), ("duplicate", 0.8), ("reorder", 0.5)],
)
def test_a_correlation_makes_runs_and_leaves_the_share_as_it_is(field, correlation):
    hits = treated(field, correlation)
    effective = MANY * (1.0 - correlation) / (1.0 + correlation)
    error = 4.0 * np.sqrt(SHARE * (1 - SHARE) / effective)
    assert np.mean(hits) == pytest.approx(SHARE, abs=error)
    assert chi_square_of_geometric(runs(hits), correlation + (1.0 - correlation) * SHARE) > 0.01
    for ahead in (1, 2):
        measured = np.corrcoef(hits[ahead:], hits[:-ahead])[0, 1]
        assert measured == pytest.approx(correlation**ahead, abs=5.0 / np.sqrt(effective))


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


@pytest.mark.slow
def test_gilbert_and_elliotts_four_numbers_mean_what_netem_says():
    p, r, bad, good = 0.05, 0.2, 0.8, 0.01
    gone = lost(loss={"p": p, "r": r, "1-h": bad, "1-k": good})
    share_bad = p / (p + r)
    mean = share_bad * bad + (1.0 - share_bad) * good
    assert np.mean(gone) == pytest.approx(mean, abs=0.01)
    # Autocovariance of the losses: that of the state, times how much the state matters, squared.
    state = share_bad * (1.0 - share_bad) * (bad - good) ** 2
    for ahead in (1, 2, 6):
        expected = state * (1.0 - p - r) ** ahead / (mean * (1.0 - mean))
        assert np.corrcoef(gone[ahead:], gone[:-ahead])[0, 1] == pytest.approx(expected, abs=0.02)
    lengths = runs(gone)
    longest = 12
    expected_runs = runs_of_a_hidden_chain(p, r, bad, good, longest)
    counted = np.bincount(np.minimum(lengths, longest), minlength=longest + 1)[1:]
    assert chisquare(counted, expected_runs * len(lengths)).pvalue > 0.01


def runs_of_a_hidden_chain(p: float, r: float, bad: float, good: float, longest: int) -> np.ndarray:
    """Shares of runs of 1, 2, ... losses, the last for all that are as long or longer."""
    chain = np.array([[1.0 - r, r], [p, 1.0 - p]])  # states: bad, good
    lose, keep = np.diag([bad, good]), np.diag([1.0 - bad, 1.0 - good])
    begun = np.array([p, r]) / (p + r) @ keep @ chain @ lose
    at_least = [begun / begun.sum()]
    for _ in range(longest - 1):
        at_least.append(at_least[-1] @ chain @ lose)
    survive = np.array([state.sum() for state in at_least])
    return np.append(survive[:-1] - survive[1:], survive[-1])


def test_a_link_that_changes_more_often_than_not_alternates():
    p, r = 0.9, 0.8
    gone = lost(SOME, loss={"p": p, "r": r})
    assert np.mean(gone) == pytest.approx(p / (p + r), abs=0.005)
    assert np.corrcoef(gone[1:], gone[:-1])[0, 1] == pytest.approx(1.0 - p - r, abs=0.02)


def test_p_alone_is_bernoullis():
    gone = lost(SOME, loss={"p": 0.25})
    assert np.mean(gone) == pytest.approx(0.25, abs=4.0 * np.sqrt(0.1875 / SOME))


BURSTY = model(
    loss={"p": 0.02, "r": 0.1, "1-h": 0.9, "1-k": 0.05},
    delay={"time": 0.1, "jitter": 0.02, "correlation": 0.8, "distribution": "paretonormal"},
    duplicate={"probability": 0.1, "correlation": 0.5},
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
