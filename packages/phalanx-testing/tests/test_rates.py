"""A rate is decided early, wrongly no more often than it says, and never by chance."""

import itertools
import signal
from dataclasses import dataclass

import numpy as np
import pytest
from phalanx_studies.statistics import beta_mixture
from phalanx_testing import RateStudy
from phalanx_testing.rates import decided, runs_to_decide

from phalanx.extend import Array, TrackVelocity, View
from tests.synthetic_studies import draws, most_misses

from .crossing import CROSSING, UNFILTERED

LOOKS = np.arange(5, 501, 5)


def passed(rate: float, bound: float) -> tuple[np.ndarray, np.ndarray]:
    """Return for each of many tests whether it passed and whether it failed, at any look."""
    successes = np.cumsum(draws(500) < rate, axis=1)[:, LOOKS - 1]
    low, high = beta_mixture(successes, LOOKS)
    decision = np.where(high < bound, 1, np.where(low >= bound, -1, 0))
    first = np.take_along_axis(decision, (decision != 0).argmax(axis=1)[:, None], axis=1)[:, 0]
    return first == 1, first == -1


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "bound"), [(0.1, 0.1), (0.1, 0.09), (0.5, 0.5)])
def test_a_rate_that_is_not_below_passes_no_more_often_than_it_says(rate, bound):
    assert passed(rate, bound)[0].sum() <= most_misses()


@pytest.mark.slow
def test_a_rate_that_is_below_fails_no_more_often_than_it_says_and_passes_early():
    passes, failures = passed(0.02, 0.1)
    assert failures.sum() <= most_misses()
    assert passes.mean() > 0.95


def test_a_decision_takes_no_more_runs_than_it_needs():
    hits = itertools.cycle([False] * 19 + [True])
    decision = decided(hits, 0.2)
    assert decision.below
    assert decision.runs < 100
    assert beta_mixture(decision.hits, decision.runs).high < 0.2
    assert decided(itertools.repeat(True), 0.2).runs < 10
    assert next(hits) in (True, False), "no hit was taken that did not count"
    assert decided(itertools.repeat(True), beta_mixture(7, 7).low).runs == 7, "at the bound itself"
    assert decided(itertools.repeat(True, 9), 1.0).below is None


@pytest.mark.slow
def test_the_runs_that_would_decide_are_estimated():
    share, bound = 0.05, 0.06
    needed = runs_to_decide(share, bound)
    assert 1000 < needed < 100_000
    assert beta_mixture(round(share * needed), needed).high < bound
    assert runs_to_decide(0.1, 0.1) is None


@pytest.mark.slow
def test_the_share_of_unsafe_runs_is_tested_with_the_same_seeds_each_time():
    study = RateStudy(CROSSING, seeds=range(40), overrides={"duration": 0.1})
    decision = study.assert_rate_below(0.3)
    assert decision.below
    assert list(study.summaries) == list(range(decision.runs))
    with pytest.raises(AssertionError, match=r"not decided .* about \d+ runs would decide"):
        study.assert_rate_below(0.001)
    with pytest.raises(AssertionError, match=r"not below 0\.5: .*; seeds 0, 1, 2, 3, 4, \.\.\."):
        study.assert_rate_below(0.5, hit=lambda summary: summary.worst_h < 0.0)


@pytest.mark.slow
def test_unsafe_runs_are_hits():
    with pytest.raises(AssertionError, match="not below"):
        RateStudy(CROSSING, overrides=UNFILTERED).assert_rate_below(0.5)


@dataclass
class Stopping(TrackVelocity):
    """A law in which Ctrl-C is pressed, or which breaks."""

    breaks: bool = False

    def input(self, view: View) -> Array:
        if view.t > 0.05:
            _ = 1 / 0 if self.breaks else signal.raise_signal(signal.SIGINT)
        return super().input(view)


@pytest.mark.slow
@pytest.mark.parametrize(("breaks", "outcome"), [(False, "stopped"), (True, "broken")])
def test_a_run_that_was_stopped_or_broke_is_no_run_of_a_rate(breaks, outcome):
    law = {"agents.0.law": {"type": f"{__name__}:Stopping", "gain": 2.0, "breaks": breaks}}
    study = RateStudy(CROSSING, seeds=[3], overrides=law)
    with pytest.raises(AssertionError, match=f"seed 3: the run is {outcome}: "):
        study.assert_rate_below(0.9)
    assert study.summaries == {}


@pytest.mark.parametrize(("bound", "confidence"), [(5.0, 0.95), (0.0, 0.95), (0.1, 95.0)])
def test_a_bound_in_percent_is_refused(bound, confidence):
    with pytest.raises(ValueError, match="expected a bound above 0 and at most 1"):
        RateStudy("unicycles").assert_rate_below(bound, confidence)
