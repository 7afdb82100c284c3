"""The coordinator of a study: has executed what is missing, and stores each row as it comes.

The inventory says which rows a study has already, and why others do not serve its plan.
"""

import logging
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import msgspec

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher import interrupt
from phalanx.scenario.model import ScenarioError
from phalanx.schema.user_code import imported_sources
from phalanx.seeded.draws import Draws
from phalanx.studies.plan import Case, Plan, Point
from phalanx.studies.row import (
    BROKEN,
    REFUSED,
    Identity,
    Row,
    digest_of_modules,
    digest_of_scenario,
    json_text,
    versions,
)
from phalanx.studies.statistics import runs_until_width
from phalanx.studies.store import Store
from phalanx.studies.work import Executing, Job, Task, compute, confirm

log = logging.getLogger("phalanx.studies")

_MOST_SURPRISES = 20
"""Violated or broken runs that are run again as processes, besides the share of all."""
_SURPRISING = (Outcome.VIOLATED, Outcome.BROKEN)


class Inventory:
    """The identities of all rows in a store."""

    def __init__(self, store: Store) -> None:
        """Read them. Raises StudyError."""
        self._store = store
        self._newest: dict[tuple[str, int], tuple[Identity, str]] = {}
        """Identity and outcome of the newest row, by overrides as JSON and seed."""
        self._keys = set[str]()
        """Of rows that may be used again, under any overrides."""
        for entry in store.entries():
            self.add(*entry)

    def add(self, identity: Identity, overrides: str, outcome: str) -> None:
        """Take a row that was stored; overrides: as JSON."""
        self._newest[overrides, identity.seed] = identity, outcome
        # A broken run is tried again. Points that are not valid scenarios have no digest.
        if outcome != BROKEN and identity.scenario:
            self._keys.add(identity.key)

    def outcome(self, identity: Identity, overrides: dict[str, Any]) -> str | None:
        """Return the outcome of the row of a run; None if there is none of use.

        A row of the same meaning under other overrides is copied to these.
        """
        text = json_text(overrides)
        newest, outcome = self._newest.get((text, identity.seed), (None, ""))
        if newest == identity:
            return None if outcome == BROKEN else outcome
        if identity.key not in self._keys:
            return None
        outcome = self._store.copy(identity.key, overrides)
        self.add(identity, text, outcome)
        return outcome

    def reason(self, identity: Identity, overrides: dict[str, Any]) -> str | None:
        """Return why a run has no row of use; None if it has one."""
        newest, outcome = self._newest.get((json_text(overrides), identity.seed), (None, ""))
        if identity.key in self._keys or (newest == identity and outcome != BROKEN):
            return None
        if newest is None:
            return "new"
        if newest == identity:
            return "broken: tried again"
        changed = newest.changed(identity)
        return f"changed: {self._store.describe(changed, newest, identity)}"


def identity_of(plan: Plan, case: Case) -> tuple[Identity, dict[str, bytes], str]:
    """Return a run's identity, its users' sources by path, and why none of its point can begin."""
    try:
        # What the seed draws is no part of it: keys of a point's runs differ by their seeds alone,
        # and a seed without room is no reason to refuse the others.
        scenario = plan.undrawn(case.point.overrides)
    except ScenarioError as error:
        return Identity("", case.seed, "", versions()), {}, str(error)
    sources = imported_sources(scenario.model_dump(mode="json"))
    identity = Identity(
        digest_of_scenario(scenario), case.seed, digest_of_modules(sources), versions()
    )
    return identity, sources, ""


def missing_by_reason(plan: Plan, store: Store) -> Counter[str]:
    """Count a plan's runs that have no row of use, by the reason. Raises StudyError."""
    inventory = Inventory(store)
    reasons: Counter[str] = Counter()
    for _, cases in groupby(plan.cases(), key=lambda case: case.point.number):
        first = next(cases)
        identity, *_ = identity_of(plan, first)
        for case in (first, *cases):
            reason = inventory.reason(identity._replace(seed=case.seed), case.point.overrides)
            if reason is not None:
                reasons[reason] += 1
    return reasons


class StudyProgress(NamedTuple):
    """The rows of a study so far."""

    done: int
    total: int
    outcomes: Counter[str]
    """Rows by outcome, those that were there before included."""
    computed: int
    """Rows that this program computed, or gave up."""
    confirmed: int
    """Runs that were repeated as processes with the same trajectory."""


Progress = Callable[[StudyProgress], None]


class _PointState:
    """The outcomes of one point's runs, in the order of seeds."""

    def __init__(self, point: Point, seeds: int) -> None:
        self.point = point
        self._outcomes: list[str | None] = [None] * seeds
        self._prefix = 0
        """Number of runs whose outcome and all before are known."""
        self._next_look = 1
        self._narrow = False

    def add(self, rank: int, outcome: str) -> None:
        """Take the outcome of the run with the seed of this rank."""
        self._outcomes[rank] = outcome
        while self._prefix < len(self._outcomes) and self._outcomes[self._prefix] is not None:
            self._prefix += 1

    def narrow(self, width: float | None) -> bool:
        """Return whether the rate of violated runs is known to this width."""
        if width is not None and not self._narrow and self._prefix >= self._next_look:
            # Each look costs as much as there are runs; the table of rows finds the exact one.
            self._next_look = self._prefix + 1 + self._prefix // 50
            outcomes = [outcome for outcome in self._outcomes[: self._prefix] if outcome != REFUSED]
            violated = [outcome == Outcome.VIOLATED for outcome in outcomes]
            self._narrow = runs_until_width(violated, width) is not None
        return self._narrow


class Coordinator:
    """Executes one plan."""

    def __init__(
        self, plan: Plan, store: Store, executor: Executor, in_flight: int, chunk: int,
        share: float, progress: Progress,
    ) -> None:  # fmt: skip
        """Prepare; study describes the options, of which none changes a row; share: to confirm."""
        self._plan, self._store, self._inventory = plan, store, Inventory(store)
        self._executing = Executing(executor, in_flight, self._report)
        self._chunk, self._share, self._progress = chunk, share, progress
        self._surprises = 0
        self._outcomes: Counter[str] = Counter()
        self._computed = self._confirmed = 0

    # A Ctrl-C must not interrupt storing: it ends the study at the next wait.
    @interrupt.handled()
    @interrupt.deferred()
    def run(self) -> None:
        """Compute every row that is missing. Raises OSError if one cannot be stored."""
        self._executing.run(self._missing())

    def _report(self) -> None:
        outcomes = self._outcomes.copy()
        finished, total = outcomes.total(), self._plan.size
        self._progress(StudyProgress(finished, total, outcomes, self._computed, self._confirmed))

    def _missing(self) -> Iterator[Task]:
        """Yield jobs for the runs that have no row with their identity."""
        for number, cases in groupby(self._plan.cases(), key=lambda case: case.point.number):
            state = _PointState(self._plan.point(number), len(self._plan.seeds))
            yield from self._missing_of(state, list(cases))

    def _missing_of(self, state: _PointState, cases: list[Case]) -> Iterator[Task]:
        """Yield jobs of one point; store rows of runs that cannot begin."""
        of_seed, sources, refusal = identity_of(self._plan, cases[0])
        chunk: list[tuple[Case, Identity]] = []
        for case in cases:
            if not refusal and state.narrow(self._plan.until_width):
                break
            identity, overrides = of_seed._replace(seed=case.seed), case.point.overrides
            outcome = self._inventory.outcome(identity, overrides)
            if outcome is not None:
                self._count(state, case, outcome)
            elif refusal:
                row = Row(identity=identity, overrides=overrides, outcome=REFUSED, reason=refusal)
                self._add(state, case, row)
            else:
                chunk.append((case, identity))
            if len(chunk) == self._chunk:
                yield self._task(state, chunk, sources)
                chunk = []
        if chunk:
            yield self._task(state, chunk, sources)

    def _task(
        self, state: _PointState, chunk: list[tuple[Case, Identity]], sources: dict[str, bytes]
    ) -> Task:
        identities = tuple(identity for _, identity in chunk)
        job = Job(self._plan.table, state.point.overrides, identities, sources)
        return Task(compute, job, tuple(partial(self._take, state, case, job) for case, _ in chunk))

    def _take(self, state: _PointState, case: Case, job: Job, row: Row) -> None:
        """Store the row of a run, and have the run repeated if it must be."""
        self._computed += 1
        self._add(state, case, row)
        if self._to_confirm(row):
            alone = job._replace(identities=(row.identity,))
            repetition = Task(confirm, alone, (partial(self._take_confirmed, row),), attempts=1)
            self._executing.first.append(repetition)

    def _to_confirm(self, row: Row) -> bool:
        if not self._share or not row.trajectory:
            return False
        if row.outcome in _SURPRISING and self._surprises < _MOST_SURPRISES:
            self._surprises += 1
            return True
        share = Draws(0, "confirm", row.identity.key).value(0)
        return share < self._share

    def _take_confirmed(self, row: Row, again: Row) -> None:
        """Store a row again with the result of its run as processes."""
        if not again.trajectory:
            seed = row.identity.seed
            log.warning("seed %d was not repeated as processes: %s", seed, again.reason)
            return
        same = again.trajectory == row.trajectory
        self._confirmed += same
        self._store.add(msgspec.structs.replace(row, confirmed=same))

    def _add(self, state: _PointState, case: Case, row: Row) -> None:
        self._store.add(row)
        self._inventory.add(row.identity, json_text(row.overrides), row.outcome)
        self._count(state, case, row.outcome)

    def _count(self, state: _PointState, case: Case, outcome: str) -> None:
        self._outcomes[outcome] += 1
        state.add(case.row - state.point.number * len(self._plan.seeds), outcome)
