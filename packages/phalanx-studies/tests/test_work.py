"""Runs of one point share what is compiled; each has the bits of a run by itself."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import msgspec
import pytest
from phalanx_studies.row import Identity, row_of
from phalanx_studies.work import Job, compute

import phalanx
from phalanx.recording.read import swarm_of
from phalanx.scenario.load import read_table
from tests.layers import layered


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario", layered(("unicycles", "guaranteed", "formation3d", "swarm2d"), ("unicycles",))
)
def test_the_rows_of_a_job_have_the_bits_of_runs(scenario):
    """Obstacles of `swarm2d` are drawn for each seed."""
    overrides = {"duration": 0.1, "network.loss": 0.3}
    identities = tuple(Identity("", seed, "", "") for seed in (3, 4))
    rows = compute(Job(read_table(scenario), overrides, identities))
    for seed, row in zip((3, 4), rows, strict=True):
        run = phalanx.run(phalanx.load(scenario, overrides, seed), engine="in-process")
        assert row.trajectory == run.summary.trajectory
        assert row.shortest == run.summary.certificates.shortest
        assert row.outcome == run.verdict
    assert rows[0].trajectory != rows[1].trajectory
    counted = msgspec.structs.replace(
        run.summary, origins={"backup": 3, "no-authority": 2, "qp": 9}
    )
    assert row_of(identities[1], {}, counted, run.recording, swarm_of(run.recording)).empty == 5


@pytest.mark.slow
@pytest.mark.parametrize("scenario", layered(("unicycles", "guaranteed", "swarm"), ("unicycles",)))
def test_a_run_with_another_seed_builds_no_function(scenario, monkeypatch):
    """Obstacles and starts of `swarm` are drawn for each seed."""
    built, make = list[str](), ca.Function.__init__

    def counted(self: ca.Function, *arguments: object) -> None:
        make(self, *arguments)
        built.append(self.name())

    monkeypatch.setattr(ca.Function, "__init__", counted)
    table = read_table(scenario)
    for seed in (0, 1):
        built.clear()
        compute(Job(table, {"duration": 0.05}, (Identity("", seed, "", ""),)))
    assert built == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario", layered(("unicycles", "guaranteed", "faults/lie-input"), ("unicycles",))
)
def test_runs_with_other_starts_laws_and_faults_have_their_own_bits(scenario):
    """Compiled functions are shared between them."""
    table = read_table(scenario)
    names = [name for name, _, _ in phalanx.load(scenario).roster()]
    group = phalanx.load(scenario).agents[0]
    states, bound = len(group.facts.states), group.disturbance.bound
    changes = (
        {},
        {"agents.0.spread": [0.3] * states},
        {"agents.0.disturbance": {"bound": bound, "kind": "adverse"}},
        {"agents.0.law": {"type": "script", "at": [0.0], "inputs": [[0.2, 0.1]]}, "seed": 3},
        {"obstacles": [{"center": [5.6, 0.6], "clearance": 0.9}]},
        {"obstacles": [{"center": [5.4, -0.9], "clearance": 1.1}]},
        {"faults": [{"kind": "turn", "agents": names[:1], "at": 0.02}]},
        {"faults": [{"kind": "hold", "from": names[0], "at": 0.02, "for": 0.1}], "duration": 0.15},
    )
    trajectories = list[str]()
    for change in changes:
        overrides = {"duration": 0.1, **change}
        (row,) = compute(Job(table, overrides, (Identity("", 0, "", ""),)))
        run = phalanx.run(phalanx.load(scenario, overrides, 0), engine="in-process")
        assert row.trajectory == run.summary.trajectory
        assert row.shortest == run.summary.certificates.shortest
        trajectories.append(row.trajectory)
    assert len({*trajectories}) > 3


@pytest.mark.slow
def test_threads_of_an_executor_compute_the_rows_of_one():
    trajectories = []
    for threads in (1, 2):
        with ThreadPoolExecutor(threads) as executor:
            study = phalanx.study(
                "guaranteed", seeds=4, overrides={"duration": 0.2}, executor=executor
            )
            trajectories.append(study.frame["trajectory"].to_list())
    assert trajectories[0] == trajectories[1]
