"""Branch a recorded run at several times, and count the branches that violate."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count, islice
from typing import NamedTuple

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import EngineError
from phalanx.launcher.forks import in_forks
from phalanx.launcher.trunk import trunk_of
from phalanx.recording.read import Recording
from phalanx.scenario.model import Scenario
from phalanx.statistics.rates import Interval, clopper_pearson


class BranchesAt(NamedTuple):
    """All branches that left the run at one time."""

    t: float
    """[s]"""
    summaries: tuple[Summary, ...]

    @property
    def violated(self) -> int:
        """The number of those that violate."""
        return sum(summary.outcome is Outcome.VIOLATED for summary in self.summaries)

    @property
    def share(self) -> float:
        """The share of those that violate."""
        return self.violated / len(self.summaries)

    @property
    def interval(self) -> Interval:
        """Interval of the probability of a violation, with 95 % confidence."""
        return clopper_pearson(self.violated, len(self.summaries))


def branch_run(
    recorded: Recording,
    times: Sequence[float],
    branches: int,
    *,
    until: float | None = None,
    at_once: int = 1,
    done: Callable[[], object] = lambda: None,
) -> list[BranchesAt]:
    """Run a recording's scenario again, and let branches leave it at some times.

    Each branch is the scenario with one more entry of `reseed`, of seeds 1, 2, 3, ... but those of
    the run. At different times the seeds are the same.

    Args:
        recorded: with the run's commands, which are given again.
        times: at which branches leave the run [s].
        branches: number of them at each time.
        until: end of each branch [s]; by default the scenario's.
        at_once: most processes that run at the same time.
        done: called after each branch.

    Raises:
        ValueError: a time is not between the last `reseed` and the end.
        EngineError: the run is one in real time, or it does not repeat itself here.
    """
    if recorded.shown:
        raise EngineError("a run in real time cannot be run again, and so has no branches")
    scenario = recorded.scenario
    if until is not None:
        scenario = scenario.model_copy(update={"duration": min(until, scenario.duration)})
    times = sorted(set(times))
    _require_times(scenario, times)
    seeds = list(islice(_other_seeds(scenario), branches))
    # Faults that the scenario declares happen again without a command.
    trunk = trunk_of(scenario, [c for c in recorded.commands if c.fault < 0])
    states, found = {state.t: state.x for state in recorded.states}, []
    try:
        for t in times:
            trunk.advance(t)
            if states.get(trunk.t, trunk.x.tolist()) != trunk.x.tolist():
                raise EngineError(
                    f"run again to t = {trunk.t:.3f} s, the run arrived elsewhere: "
                    "`phalanx verify` says where it departs"
                )
            summaries = []
            for summary in in_forks((partial(trunk.reseeded, t, s) for s in seeds), at_once):
                summaries.append(summary)
                done()
            found.append(BranchesAt(t, tuple(summaries)))
    finally:
        trunk.close()
    return found


def from_when(curve: Sequence[BranchesAt], share: float) -> float | None:
    """Return the first time from which on at least this share violates [s]; None: never."""
    found = None
    for each in reversed(curve):
        if each.share < share:
            break
        found = each.t
    return found


class Landmark(NamedTuple):
    """A moment of the run with which its branches are compared."""

    t: float
    """[s]"""
    happens: str
    """In words."""


def landmarks(summary: Summary | None) -> list[Landmark]:
    """Return the first violation of a run, and before it the first pair without a certificate."""
    if summary is None or not summary.violations:
        return []
    first = min(summary.violations, key=lambda violation: violation.first)
    found, lost = [Landmark(first.first, f"{first.pair} leaves the safe set")], summary.certificates
    if lost.uncovered is not None and lost.uncovered_at is not None:
        found.append(Landmark(lost.uncovered_at, f"{lost.uncovered} has no certificate"))
    return found


def _require_times(scenario: Scenario, times: Sequence[float]) -> None:
    low = scenario.reseed[-1].at if scenario.reseed else 0.0
    for t in times:
        if not low < t < scenario.duration:
            raise ValueError(
                f"expected times after {low:g} s and before the end, {scenario.duration:g} s, "
                f"got {t:g}"
            )


def _other_seeds(scenario: Scenario) -> Iterator[int]:
    used = {scenario.seed, *(each.seed for each in scenario.reseed)}
    return (seed for seed in count(1) if seed not in used)
