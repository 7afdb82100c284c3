"""phalanx fit disturbance: the bound that recorded runs need."""

import tomllib

import pytest

import phalanx
from phalanx.cli.app import status

BOUND = 0.4


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two short runs whose disturbances are within BOUND."""
    table = {f"agents.{k}.disturbance.bound": BOUND for k in (0, 1)}
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


def printed(capsys, *arguments):
    assert status(["fit", "disturbance", *arguments]) == 0
    return capsys.readouterr().out


@pytest.mark.nightly
@pytest.mark.slow
def test_the_line_for_the_scenario_bounds_what_was_drawn(runs, capsys):
    text = printed(capsys, *runs)
    lines = [line for line in text.splitlines() if line.startswith("disturbance = ")]
    bounds = [tomllib.loads(line)["disturbance"]["bound"] for line in lines]
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
