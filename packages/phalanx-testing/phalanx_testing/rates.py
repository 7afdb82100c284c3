"""Rates over seeds, tested one run after the other, and no longer than it takes to decide."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from phalanx_studies.statistics import LEVEL, Interval, beta_mixture

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.native.loop.fastest import finish
from phalanx.swarm.runnable import shared_rows
from phalanx_testing.conditions import Source, faulty

MOST_RUNS = 1000
"""Budget of a test unless another is given."""
_LISTED = 5
"""Most seeds in a message."""


class Decision(NamedTuple):
    """The rate of hits as far as it is known."""

    below: bool | None
    """Whether it is below the bound; None if that is not known."""
    hits: int
    runs: int
    interval: Interval
    """Of a confidence sequence: it holds although the number of runs depends on it."""


def decided(hits: Iterable[bool], bound: float, confidence: float = LEVEL) -> Decision:
    """Take hits until it is known whether their rate is below a bound, or none is left."""
    decision = Decision(None, 0, 0, Interval(0.0, 1.0))
    for runs, hit in enumerate(hits, 1):
        count = decision.hits + hit
        interval = beta_mixture(count, runs, confidence)
        below = True if interval.high < bound else False if interval.low >= bound else None
        decision = Decision(below, count, runs, interval)
        if below is not None:
            break
    return decision


def runs_to_decide(share: float, bound: float, confidence: float = LEVEL) -> int | None:
    """Return about how many runs with this share of hits decide; None if it is the bound itself."""
    runs = 1
    while runs < 2**40:
        low, high = beta_mixture(round(share * runs), runs, confidence)
        if high < bound or low >= bound:
            return runs
        runs += max(1, runs // 20)
    return None


class RateStudy:
    """Runs of one scenario with one seed after the other; nothing in them is left to chance."""

    def __init__(self, scenario: Source, *, seeds: Iterable[int] | None = None, **conditions: Any):
        """Declare the runs.

        Args:
            scenario: as `faulty` takes it.
            seeds: in the order of their runs; by default 0, 1, ... up to the budget.
            conditions: faults, overrides and fields of the network, as `faulty` takes them.
        """
        self._scenario, self._conditions = scenario, conditions
        self._seeds = range(MOST_RUNS) if seeds is None else list(seeds)
        self.summaries: dict[int, Summary] = {}
        """Of the runs so far, by seed."""

    def assert_rate_below(
        self,
        bound: float,
        confidence: float = LEVEL,
        hit: Callable[[Summary], bool] = lambda summary: summary.outcome is Outcome.VIOLATED,
    ) -> Decision:
        """Claim that the share of violated runs, over all seeds there are, is below a bound.

        It runs seeds until a confidence sequence excludes the bound: a rate that is not below it
        passes with a probability of 1 - confidence at most, one that is below fails no more often.

        hit: what is counted in the place of violated runs.

        Raises AssertionError: it is not below, not decided after all seeds, or a run broke;
        ValueError: the bound or the confidence is no share.
        """
        __tracebackhide__ = True
        if not (0.0 < bound <= 1.0 and 0.0 < confidence < 1.0):
            expected = "a bound above 0 and at most 1, and a confidence between 0 and 1"
            raise ValueError(f"expected {expected}, got {bound:g} and {confidence:g}")
        hits = list[int]()

        def outcomes() -> Iterator[bool]:
            for seed in self._seeds:
                if outcome := hit(self._summary(seed)):
                    hits.append(seed)
                yield outcome

        decision = decided(outcomes(), bound, confidence)
        if not decision.below:
            raise AssertionError(self._words(decision, bound, confidence, hits))
        return decision

    def _words(self, decision: Decision, bound: float, confidence: float, hits: list[int]) -> str:
        low, high = decision.interval
        interval = (
            f"{decision.hits} of {decision.runs} runs: {low:.4g} to {high:.4g} ({confidence:g})"
        )
        seeds = ", ".join(map(str, hits[:_LISTED])) + (", ..." if len(hits) > _LISTED else "")
        failing = f"; seeds {seeds}" if hits else ""
        if decision.below is False:
            return f"the rate is not below {bound:g}: {interval}{failing}"
        share = decision.hits / max(decision.runs, 1)
        needed = runs_to_decide(share, bound, confidence)
        more = f"about {needed} runs would decide" if needed else "no number of runs would decide"
        return f"not decided whether the rate is below {bound:g}: {interval}; {more}{failing}"

    def _summary(self, seed: int) -> Summary:
        """Return the summary of a run, which is executed once."""
        if seed not in self.summaries:
            scenario = faulty(self._scenario, seed=seed, **self._conditions)
            summary = finish(shared_rows(scenario)).summary
            if summary.outcome in (Outcome.BROKEN, Outcome.STOPPED):
                raise AssertionError(f"seed {seed}: the run is {summary.outcome}: {summary.reason}")
            self.summaries[seed] = summary
        return self.summaries[seed]
