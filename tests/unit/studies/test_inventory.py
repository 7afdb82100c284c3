"""A row is used again if all that it follows from is the same; if not, it is said what changed."""

import pytest

from phalanx.scenario.load import load
from phalanx.studies.identity import Identity, digest_of_scenario
from phalanx.studies.inventory import Inventory, identity_of, missing_by_reason
from phalanx.studies.plan import plan_from
from phalanx.studies.row import Row
from phalanx.studies.store import Store

PLAN = plan_from({"scenario": "unicycles", "seeds": "0:3"})


@pytest.fixture
def store(tmp_path):
    """Yield an open store."""
    with Store(tmp_path).open(PLAN) as opened:
        yield opened


def stored(store, identity: Identity, outcome: str = "safe", **overrides: object) -> None:
    """Store a row of this identity."""
    store.add(Row(identity=identity, overrides=overrides, outcome=outcome, reason=""))


def test_what_was_never_run_is_new(store):
    assert missing_by_reason(PLAN, store) == {"new": 3}


def test_rows_of_the_same_identity_are_used_again(store):
    identity, *_ = identity_of(PLAN, PLAN.case(0))
    for seed in range(2):
        stored(store, identity._replace(seed=seed))
    assert missing_by_reason(PLAN, store) == {"new": 1}


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"scenario": "other"}, "changed: the scenario"),
        ({"modules": "other"}, "changed: your modules"),
        ({"scenario": "other", "modules": "other"}, "changed: the scenario, your modules"),
    ],
)
def test_it_is_said_which_input_changed(store, changed, reason):
    identity, *_ = identity_of(PLAN, PLAN.case(0))
    stored(store, identity._replace(**changed))
    assert missing_by_reason(PLAN, store) == {reason: 1, "new": 2}


def test_a_library_that_changed_is_named_with_both_versions(store, tmp_path):
    identity, *_ = identity_of(PLAN, PLAN.case(0))
    stored(store, identity._replace(versions="before"))
    known = (tmp_path / "versions.json").read_text().replace('"numpy": "', '"numpy": "0.')
    known = known.replace(identity.versions, "before")
    now = (tmp_path / "versions.json").read_text()
    (tmp_path / "versions.json").write_text(known[:-1].rstrip().rstrip("}") + "}," + now[1:])
    (reason, _), *_ = missing_by_reason(PLAN, store).items()
    assert reason.startswith("changed: numpy 0.")


def test_a_broken_run_is_tried_again(store):
    identity, *_ = identity_of(PLAN, PLAN.case(0))
    stored(store, identity, "broken")
    assert missing_by_reason(PLAN, store) == {"broken: tried again": 1, "new": 2}
    assert Inventory(store).outcome(identity, {}) is None


def test_an_axis_at_the_value_that_the_scenario_has_uses_its_rows(store):
    identity, *_ = identity_of(PLAN, PLAN.case(0))
    stored(store, identity)
    varied = plan_from({"scenario": "unicycles", "vary": {"network.loss": [0.0]}})
    of_axis, *_ = identity_of(varied, varied.case(0))
    assert Inventory(store).outcome(of_axis, {"network.loss": 0.0}) == "safe"


def test_the_digest_follows_the_meaning_of_a_scenario_and_not_its_text():
    scenario = load("unicycles")
    assert digest_of_scenario(scenario) == digest_of_scenario(load("unicycles", seed=5))
    given = load("unicycles", {"network.loss": 0.0, "description": "another"})
    assert digest_of_scenario(scenario) == digest_of_scenario(given)
    assert digest_of_scenario(scenario) != digest_of_scenario(load("unicycles", {"duration": 1.0}))


@pytest.mark.parametrize("scenario", ["swarm2d", "formation3d"])
def test_a_runs_key_does_not_depend_on_the_other_seeds_of_its_plan(scenario):
    """Starts of the one and obstacles of the other are drawn for each seed."""
    keys = []
    for seeds in ([0, 5], [5, 0]):
        plan = plan_from({"scenario": scenario, "seeds": seeds})
        identity, *_ = identity_of(plan, next(plan.cases()))
        keys.append(identity._replace(seed=0).key)
    assert keys[0] == keys[1]
