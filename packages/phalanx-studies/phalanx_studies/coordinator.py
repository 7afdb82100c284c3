"""The coordinator of a study: has executed what is missing, and stores each row as it comes."""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from phalanx.launcher import interrupt
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.schema.user_code import imported_sources
from phalanx_studies.plan import Case, Plan
from phalanx_studies.row import (
    BROKEN,
    REFUSED,
    Identity,
    Row,
    digest_of_modules,
    digest_of_scenario,
    json_text,
    versions,
)
from phalanx_studies.store import Store
from phalanx_studies.work import Executing, Job, Task, compute


def identity_of(plan: Plan, case: Case) -> tuple[Identity, dict[str, bytes], str]:
    """Return a run's identity, its users' sources by path, and why none of its point can begin."""
    try:
        # What the seed draws is no part of it: keys of a point's runs differ by their seeds alone,
        # and a seed without room is no reason to refuse the others.
        scenario = plan.undrawn(case.point.overrides)
    except ScenarioError as error:
        return Identity("", case.seed, "", versions()), {}, str(error)
    sources = imported_sources(scenario.model_dump(mode="json"))
    code = digest_of_modules({**sources, **_program_files(scenario)})
    identity = Identity(digest_of_scenario(scenario), case.seed, code, versions())
    return identity, sources, ""


def _program_files(scenario: Scenario) -> dict[str, bytes]:
    """Return the files among the words of users' own programs, by path."""
    words = {Path(word) for group in scenario.agents for word in group.program}
    return {str(path): path.read_bytes() for path in words if path.is_file()}


class StudyProgress(NamedTuple):
    """The rows of a study so far."""

    done: int
    total: int
    outcomes: Counter[str]
    """Rows by outcome, those that were there before included."""
    computed: int
    """Rows that this program computed, or gave up."""


Progress = Callable[[StudyProgress], None]


class Coordinator:
    """Executes one plan."""

    def __init__(
        self, plan: Plan, store: Store, executor: Executor, in_flight: int, chunk: int,
        progress: Progress,
    ) -> None:  # fmt: skip
        """Prepare; study describes the options, of which none changes a row. Raises StudyError."""
        self._plan, self._store, self._chunk = plan, store, chunk
        self._executing = Executing(executor, in_flight, self._report)
        self._progress = progress
        self._newest = {
            (overrides, identity.seed): (identity, outcome)
            for identity, overrides, outcome in store.entries()
        }
        """Identity and outcome of the newest row, by overrides as JSON and seed."""
        self._outcomes: Counter[str] = Counter()
        self._computed = 0

    # A Ctrl-C must not interrupt storing: it ends the study at the next wait.
    @interrupt.handled()
    @interrupt.deferred()
    def run(self) -> None:
        """Compute every row that is missing. Raises OSError if one cannot be stored."""
        self._executing.run(self._missing())

    def _report(self) -> None:
        outcomes = self._outcomes.copy()
        self._progress(StudyProgress(outcomes.total(), self._plan.size, outcomes, self._computed))

    def _missing(self) -> Iterator[Task]:
        """Yield jobs for the runs that have no row with their identity."""
        for _, cases in groupby(self._plan.cases(), key=lambda case: case.point.number):
            yield from self._missing_of(list(cases))

    def _missing_of(self, cases: list[Case]) -> Iterator[Task]:
        """Yield jobs of one point; store rows of runs that cannot begin."""
        of_seed, sources, refusal = identity_of(self._plan, cases[0])
        overrides, identities = cases[0].point.overrides, list[Identity]()
        for case in cases:
            identity = of_seed._replace(seed=case.seed)
            newest, outcome = self._newest.get((json_text(overrides), case.seed), (None, ""))
            if newest == identity and outcome != BROKEN:  # a broken run is tried again
                self._outcomes[outcome] += 1
            elif refusal:
                row = Row(identity=identity, overrides=overrides, outcome=REFUSED, reason=refusal)
                self._add(row)
            else:
                identities.append(identity)
        for begin in range(0, len(identities), self._chunk):
            few = tuple(identities[begin : begin + self._chunk])
            job = Job(self._plan.table, overrides, few, sources)
            yield Task(compute, job, (self._take,) * len(few))

    def _take(self, row: Row) -> None:
        """Store the row of a run."""
        self._computed += 1
        self._add(row)

    def _add(self, row: Row) -> None:
        self._store.add(row)
        self._outcomes[row.outcome] += 1
