"""Splitting of a scenario's runs: an estimate of how rarely it is violated.

A run that came nearest to a violation branches where it did, by one more entry of `reseed`.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.launcher.forks import in_forks
from phalanx.launcher.in_process_engine import RecordsInMemory, simulate
from phalanx.recording.records import State
from phalanx.recording.tables import h_of_pairs
from phalanx.scenario.load import from_json, to_json
from phalanx.scenario.model import Reseed, Scenario
from phalanx.statistics.splitting import RareEvent, combined, split
from phalanx.swarm.runnable import shared_rows


class RunPath(NamedTuple):
    """A run as a path; its score is the largest h of a pair."""

    scenario: str
    """Resolved, as JSON."""
    seed: int
    reseed: tuple[Reseed, ...]
    times: Array
    """Of the instants [s], shape (s,)."""
    h: Array
    """Largest h at each, shape (s,)."""

    @property
    def peak(self) -> float:
        """The largest h of the run; above 0 it is unsafe."""
        return float(self.h.max())

    def branch(self, level: float, seed: int) -> "RunPath":
        """Return the run that is drawn again from where h first exceeds a level."""
        # The time of a reseed is above 0. What is decided at t = 0 then stays, with the start.
        t = max(float(self.times[np.argmax(self.h > level)]), math.ulp(0.0))
        kept = tuple(each for each in self.reseed if each.at < t)
        return _path(self.scenario, self.seed, (*kept, Reseed(at=t, seed=seed)))


def begin(scenario: str, seed: int) -> RunPath:
    """Run a resolved scenario, as JSON, with a seed."""
    return _path(scenario, seed, from_json(scenario).reseed)


def rare_violation(
    scenario: Scenario,
    *,
    level: float = 0.0,
    paths: int = 50,
    stopped: int = 5,
    repeats: int = 4,
    seed: int = 0,
    at_once: int = 1,
) -> RareEvent:
    """Estimate the probability that some pair's h exceeds a level in a run of a scenario.

    Times between two instants do not count, as they do for the verdict.

    Args:
        scenario: resolved, as phalanx.load returns it. Its own seed is not used.
        level: of h.
        paths, stopped: as splitting.split takes them.
        repeats: number of independent estimates, two at least.
        seed: of all choices.
        at_once: processes at the same time.

    Raises:
        ScenarioError: the scenario cannot be run.
        ValueError: there are too few paths or repeats.
    """
    if repeats < 2:
        raise ValueError(f"repeats: expected 2 or more, got {repeats}")
    written = to_json(scenario)
    shared_rows(scenario)  # compiled once: forked processes inherit it

    def executes(work: Any, items: Any) -> Any:
        return in_forks((partial(work, item) for item in items), at_once)

    options: dict[str, Any] = {"paths": paths, "stopped": stopped, "executes": executes}
    seeds = range(seed * repeats, (seed + 1) * repeats)
    return combined([split(partial(begin, written), level, seed=s, **options) for s in seeds])


def _path(scenario: str, seed: int, reseed: tuple[Reseed, ...]) -> RunPath:
    drawn = from_json(scenario).model_copy(update={"seed": seed, "reseed": reseed})
    rows, records = shared_rows(drawn), RecordsInMemory()
    simulate(rows, records)
    states = records.of(State)
    h = np.max(list(h_of_pairs(rows.swarm, np.array([s.x for s in states])).values()), axis=0)
    return RunPath(scenario, seed, reseed, np.array([s.t for s in states]), h)
