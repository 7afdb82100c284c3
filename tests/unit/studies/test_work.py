"""Runs of one point share what is compiled; each has the bits of a run by itself."""

import pytest

import phalanx
from phalanx.scenario.load import read_table
from phalanx.studies.identity import Identity
from phalanx.studies.work import Job, compute


@pytest.mark.parametrize(
    "scenario", ["unicycles", "guaranteed", pytest.param("formation3d", marks=pytest.mark.nightly)]
)
def test_the_rows_of_a_job_have_the_bits_of_runs(scenario):
    overrides = {"duration": 0.1, "network.loss": 0.3}
    identities = tuple(Identity("", seed, "", "") for seed in (3, 4))
    rows = compute(Job(read_table(scenario), overrides, identities))
    for seed, row in zip((3, 4), rows, strict=True):
        run = phalanx.run(phalanx.load(scenario, overrides, seed), engine="in-process")
        assert row.trajectory == run.summary.trajectory
        assert row.shortest == run.summary.certificates.shortest
        assert row.outcome == run.verdict
    assert rows[0].trajectory != rows[1].trajectory


def test_obstacles_that_are_drawn_are_drawn_for_each_seed():
    identities = tuple(Identity("", seed, "", "") for seed in (0, 1))
    rows = compute(Job(read_table("swarm2d"), {"duration": 0.05}, identities))
    for seed, row in zip((0, 1), rows, strict=True):
        run = phalanx.run(phalanx.load("swarm2d", {"duration": 0.05}, seed), engine="in-process")
        assert row.trajectory == run.summary.trajectory
