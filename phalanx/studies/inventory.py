"""The rows that a study has already: which of them serve a plan, and why others do not."""

from collections import Counter
from itertools import groupby
from typing import Any

from phalanx.scenario.load import ScenarioError
from phalanx.schema.user_code import imported_sources
from phalanx.studies.identity import Identity, digest_of_modules, digest_of_scenario, versions
from phalanx.studies.plan import Case, Plan
from phalanx.studies.row import BROKEN, json_text
from phalanx.studies.store import Store


class Inventory:
    """The identities of all rows in a store."""

    def __init__(self, store: Store) -> None:
        """Read them. Raises StudyError."""
        self._store = store
        self._newest: dict[tuple[str, int], tuple[Identity, str]] = {}
        """Identity and outcome of the newest row, by overrides as JSON and seed."""
        self._keys = set[str]()
        """Of rows that may be used again, under any overrides."""
        for known in store.known():
            self.add(*known)

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
        scenario = plan.undrawn(case.point)
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
    found: Counter[str] = Counter()
    for _, cases in groupby(plan.cases(), key=lambda case: case.point.number):
        first = next(cases)
        identity, *_ = identity_of(plan, first)
        for case in (first, *cases):
            reason = inventory.reason(identity._replace(seed=case.seed), case.point.overrides)
            if reason is not None:
                found[reason] += 1
    return found
