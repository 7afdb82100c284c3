"""A search: an optimiser's generations, evaluated by an executor, journalled, and archived.

The optimiser asks for the same points again when a search goes on where it was: those that the
journal has are not run again. So a killed search, and one with other workers, ends the same.
"""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from typing import Any

from phalanx_studies.row import (
    BROKEN,
    Identity,
    Row,
    digest_of_modules,
    json_text,
    row_from,
    versions,
)
from phalanx_studies.store import Store
from phalanx_studies.work import Executing, Job, Task, compute

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher import interrupt
from phalanx.scenario.attack import Attack
from phalanx.scenario.load import load
from phalanx.schema.user_code import imported_sources
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx_attacks.archive import Archive, Find, find_of
from phalanx_attacks.knobs import Fields, Point, Space
from phalanx_attacks.optimisers import OPTIMISERS
from phalanx_attacks.robustness import START, measured, robustness_of, scales_of

_CLOSE = 1.0
"""Robustness below which a run is tried again on fresh seeds: it lost its certificate."""
_NONE = 10.0
"""Cost of a run in which the target has no pair left."""
_MOST_REFUSED = 10
"""Points that are not run, for each run of the budget, after which a search ends."""
_Key = tuple[str, int]
"""Overrides as JSON, and the seed."""


@dataclass(frozen=True)
class Options:
    """Options of a search; all but the budget decide what its rows are."""

    budget: int
    """Most runs of each optimiser, without those on fresh seeds."""
    preset: str | None = None
    """Adds knobs; by default `within` for a scenario without an [attack] table."""
    optimiser: str = next(iter(OPTIMISERS))
    seed: int = 0
    """Of the search; the runs have the scenario's."""
    batch: int | None = None
    """Points in a generation; by default the optimiser's."""
    fresh: int = 4
    """Seeds on which the best of a generation is repeated."""
    first: bool = False
    """Whether each optimiser ends with the generation of its first violated run."""
    baseline: bool = True
    """Whether a random search with the same budget follows."""

    @property
    def optimisers(self) -> list[str]:
        """Names of the optimisers that search, in this order."""
        return list(dict.fromkeys([self.optimiser, *["random"] * self.baseline]))


@dataclass
class History:
    """The evaluations of one optimiser, in their order."""

    optimiser: str
    finds: list[Find] = field(default_factory=list)
    """Completed runs only; inadmissible starts are skipped."""
    refused: int = 0
    """Points that were not run."""
    begun: int = 0
    """Number of runs, with those of the generation that goes on."""
    fresh: int = 0
    """Runs on fresh seeds, which the budget does not count."""

    @property
    def best(self) -> float:
        """The least robustness."""
        return min((find.robustness for find in self.finds), default=float("inf"))

    @property
    def violated(self) -> list[Find]:
        """The violated runs."""
        return [find for find in self.finds if find.row.outcome == Outcome.VIOLATED]


class _BudgetSpentError(Exception):
    """The optimiser has had all its evaluations."""


class Search:
    """A search of a scenario's knobs."""

    def __init__(
        self,
        space: Space,
        attack: Attack,
        store: Store,
        executor: Executor,
        options: Options,
        progress: Callable[[History], object],
    ) -> None:
        """Prepare a search in an open store. Raises ScenarioError, StudyError."""
        base = load(space.table)
        swarm = build_swarm(base)
        self.space, self.seed, self.archive = space, base.seed, Archive(base.duration)
        self.histories: list[History] = []
        self._work = partial(compute, work=partial(measured, attack, scales_of(swarm)))
        self._store, self._options, self._progress = store, options, progress
        self._executing = Executing(executor, math.inf)
        self._modules = imported_sources(base.model_dump(mode="json"))
        self._identity = Identity("", base.seed, digest_of_modules(self._modules), versions())
        self._targets = _targets(swarm)
        self.unseen = set[_Key]()
        """Of the store's searched rows, those that no optimiser asked for yet."""
        self._rows_by_key: dict[_Key, Row] = {}
        for columns in store.frame().iter_rows(named=True):
            row = row_from(columns)
            if row.searched:
                self.unseen.add((columns["overrides"], row.identity.seed))
            if row.identity[2:] == self._identity[2:] and row.outcome != BROKEN:
                self._rows_by_key[columns["overrides"], row.identity.seed] = row

    # A Ctrl-C must not interrupt storing: it ends the search at the next wait.
    @interrupt.handled()
    @interrupt.deferred()
    def run(self, optimiser: str) -> None:
        """Let an optimiser make its runs. Raises OSError."""
        history = History(optimiser)
        self.histories.append(history)
        self._turns = cycle(self._targets)
        self.next_target()
        self._progress(history)
        with contextlib.suppress(_BudgetSpentError):
            OPTIMISERS[optimiser](self.space, self, self._options.seed, self._options.batch)

    def costs(self, points: Sequence[Point]) -> list[float]:
        """Evaluate a generation, or what the budget leaves of it: the cost of each point's run."""
        history, budget = self.histories[-1], self._options.budget
        runs = [(self.space.overrides(point), self.seed) for point in points]
        rows: list[Row] = []
        begun: list[Row] = []
        while more := min(budget - len(history.finds) - len(begun), len(runs) - len(rows)):
            rows += self._rows(runs[len(rows) : len(rows) + more], searched=True)
            begun = [row for row in rows if START not in robustness_of(row)]
        first = len(history.finds) + 1
        generation = [find_of(number, row) for number, row in enumerate(begun, first)]
        new = [find for find in generation if self.archive.add(find)]
        history.finds += generation
        history.refused += len(rows) - len(begun)
        history.begun = len(history.finds)
        if new:
            self._try_again(min(new, key=lambda find: find.robustness))
        self._progress(history)
        ended = self._options.first and history.violated
        if ended or len(history.finds) >= budget or history.refused >= _MOST_REFUSED * budget:
            raise _BudgetSpentError
        return [self._cost(row) for row in rows]

    def next_target(self) -> None:
        """Choose the next target: the weakest pair of all, or of one adversary."""
        self._target = next(self._turns)

    def _cost(self, row: Row) -> float:
        robustness = robustness_of(row)
        if START in robustness:
            return robustness[START]
        return min((v for pair, v in robustness.items() if pair in self._target), default=_NONE)

    def _try_again(self, find: Find) -> None:
        """Repeat a run on fresh seeds: it may need its own disturbances."""
        fresh = self._options.fresh
        if find.robustness < _CLOSE and fresh:
            seeds = range(self.seed + 1, self.seed + 1 + fresh)
            again = [(find.row.overrides, seed) for seed in seeds]
            self.archive.confirm(find, self._rows(again, searched=False))
            self.histories[-1].fresh += fresh

    def _rows(self, cases: Sequence[tuple[Fields, int]], searched: bool) -> list[Row]:
        """Return the row of each run, in this order; those that the journal lacks are computed."""
        keys = [(json_text(overrides), seed) for overrides, seed in cases]
        runs = dict(zip(keys, cases, strict=True))
        missing = [
            self._task(key, *run, searched)
            for key, run in runs.items()
            if key not in self._rows_by_key
        ]
        self._executing.run(iter(missing))
        self.unseen.difference_update(keys)
        return [self._rows_by_key[key] for key in keys]

    def _task(self, key: _Key, overrides: Fields, seed: int, searched: bool) -> Task:
        identities = (self._identity._replace(seed=seed),)
        job = Job(self.space.table, overrides, identities, self._modules)
        return Task(self._work, job, (partial(self._take, key, searched),))

    def _take(self, key: _Key, searched: bool, row: Row) -> None:
        row.searched = searched
        self._store.add(row)
        self._rows_by_key[key] = row
        history = self.histories[-1]
        history.begun += searched and START not in robustness_of(row)
        self._progress(history)


def _targets(swarm: Swarm) -> list[set[str]]:
    """Return labels of pairs: all of them, then those of each adversary if there are several."""
    labels = {pair: swarm.safe_set.label(pair) for pair in swarm.safe_set.pairs}
    adversaries = [j for j, member in enumerate(swarm.members) if member.adversary]
    of_each = [{label for pair, label in labels.items() if j in pair} for j in adversaries]
    return [{*labels.values()}, *(of_each if len(of_each) > 1 else [])]


def declaration(space: Space, attack: Attack, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return all that the rows of a search depend on, as a table."""
    table = attack.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {**options, "scenario": {**space.table, "attack": table}}
