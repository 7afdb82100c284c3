"""Runs as paths of multilevel splitting: each branch is a run with one more entry of reseed."""

import json

import numpy as np
import pytest

import phalanx
from phalanx.branches.rare import begin, rare_violation
from phalanx.scenario.load import to_json

SHORT = {"duration": 0.3, "safety.eta": 0.0, "obstacles": []}


def test_a_branch_has_the_bits_of_the_run_up_to_its_level_and_of_a_reseed_after_it():
    scenario = phalanx.load("unicycles", SHORT)
    path = begin(to_json(scenario), 3)
    level = float(np.median(path.h))
    branch = path.branch(level, 8)
    first = int(np.argmax(path.h > level))
    assert (branch.times[: first + 1] == path.times[: first + 1]).all()
    assert (branch.h[: first + 1] == path.h[: first + 1]).all()
    assert branch.h[-1] != path.h[-1]
    reseed = [{"at": float(path.times[first]), "seed": 8}]
    again = phalanx.load("unicycles", {**SHORT, "reseed": reseed}, seed=3)
    run = phalanx.run(again, engine="in-process")
    largest = run.h.drop("run", "scenario", "seed", "t").to_numpy().max(axis=1)
    assert largest.tolist() == branch.h.tolist()
    higher = branch.branch(float(branch.h[first]) - 1e-9, 9)
    assert [each.seed for each in higher.reseed] == [9], "at the same instant it takes its place"
    assert branch.branch(-np.inf, 5).times[0] == 0.0


@pytest.mark.nightly
def test_an_event_of_half_the_runs_is_found_about_so_often():
    scenario = phalanx.load("unicycles", SHORT)
    peaks = [begin(to_json(scenario), seed).peak for seed in range(100, 116)]
    level = float(np.median(peaks))
    found = rare_violation(scenario, level=level, paths=6, stopped=2, repeats=3, at_once=2)
    assert found.interval.low < 0.5 < found.interval.high
    assert found.runs >= 18
    assert json.loads(to_json(scenario))["seed"] == 0


def test_one_estimate_has_no_interval():
    with pytest.raises(ValueError, match="repeats: expected 2 or more, got 1"):
        rare_violation(phalanx.load("unicycles", SHORT), repeats=1)
