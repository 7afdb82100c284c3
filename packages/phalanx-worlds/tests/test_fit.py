"""phalanx fit disturbance: the bound that recorded runs need."""

import tomllib

import numpy as np
import pytest
from phalanx_worlds.fit_command import _Fit, conformal_bound

import phalanx
from phalanx.cli.app import status
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import swarm_of

BOUND = 0.4
EVERY = {f"agents.{k}.disturbance.every": 0.5 for k in (0, 1)}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two short runs whose disturbances are within BOUND."""
    table = {f"agents.{k}.disturbance.bound": BOUND for k in (0, 1)} | EVERY
    return [
        str(
            phalanx.run(
                phalanx.load("unicycles", overrides={"duration": 0.3, **table}, seed=seed),
                engine="in-process",
                out=tmp_path_factory.mktemp("runs"),
            ).folder
        )
        for seed in (1, 2)
    ]


def intervals(run):
    recording = phalanx.open(run).recording
    return disturbances_of(recording, swarm_of(recording))


def line_of(text):
    """Each group's line for the scenario, as a table."""
    lines = [line for line in text.splitlines() if line.startswith("disturbance = ")]
    return [tomllib.loads(line)["disturbance"] for line in lines]


def test_the_bound_for_the_scenario_is_never_below_what_was_needed(runs, capsys):
    """The conformal bound is of the next interval: at a low level recorded ones are above it."""
    needed = np.concatenate([table.size for table in intervals(runs[0])])
    text = printed(capsys, runs[0], "--level", "0.5")
    tables = line_of(text)
    assert max(table["bound"] for table in tables) >= needed.max()
    bounds = {f"agents.{k}.disturbance.bound": table["bound"] for k, table in enumerate(tables)}
    again = phalanx.load("unicycles", {"duration": 0.3, **EVERY, **bounds}, seed=1)
    for table, group in zip(tables, again.agents, strict=True):
        assert group.disturbance.model_dump() == {"kind": "random", **table}


@pytest.mark.parametrize("bound", [0.0408500000001, 0.04085, 1.0, 9.9999001, 1e-7, 123456.0])
def test_the_bound_is_rounded_up_to_four_digits(bound):
    found = _Fit(largest=bound, p99=0.0, conformal=0.5 * bound).bound
    assert bound <= found <= bound * 1.001
    assert found == float(f"{found:.4g}")


@pytest.mark.parametrize(("n", "share"), [(99, 0.9), (999, 0.99)])
def test_the_conformal_bound_holds_for_the_next_value_as_often_as_it_says(n, share):
    rng = np.random.default_rng(n)
    kept = [
        study[-1] <= conformal_bound(study[:-1], share) for study in rng.normal(size=(2000, n + 1))
    ]
    assert abs(np.mean(kept) - share) < 4.0 * (share * (1.0 - share) / len(kept)) ** 0.5


def test_too_few_values_have_no_conformal_bound():
    values = np.arange(99.0)
    assert conformal_bound(values, 0.99) == 98.0
    assert [conformal_bound(some, 0.99) for some in (values[1:], [])] == [np.inf, np.inf]
    assert conformal_bound(values, 0.0) == np.inf


def printed(capsys, *arguments):
    assert status(["fit", "disturbance", *arguments]) == 0
    return capsys.readouterr().out


@pytest.mark.nightly
@pytest.mark.slow
def test_the_line_for_the_scenario_bounds_what_was_drawn(runs, capsys):
    text = printed(capsys, *runs)
    bounds = [each["bound"] for each in line_of(text)]
    assert len(bounds) == 2
    assert all(0.3 * BOUND < bound < 1.01 * BOUND for bound in bounds)
    assert "# check with these bounds: " in text


@pytest.mark.nightly
def test_two_runs_have_the_intervals_of_both(runs, capsys):
    counted = [
        int(text.partition(": ")[2].partition(" intervals")[0])
        for text in (printed(capsys, *some) for some in (runs[:1], runs[1:], runs))
    ]
    assert counted[0] + counted[1] == counted[2]


@pytest.mark.nightly
@pytest.mark.slow
def test_a_lower_level_needs_fewer_intervals(runs, capsys):
    assert "too few intervals" in printed(capsys, runs[0], "--level", "0.99999")
    assert "too few intervals" not in printed(capsys, runs[0], "--level", "0.9")


def test_runs_of_other_agents_are_refused(runs, tmp_path, capsys):
    other = phalanx.load("one-on-one", ["duration=0.05"])
    folder = phalanx.run(other, engine="in-process", out=tmp_path).folder
    assert status(["fit", "disturbance", runs[0], str(folder)]) == 64
    assert "expected the agents and dynamics of" in capsys.readouterr().err
