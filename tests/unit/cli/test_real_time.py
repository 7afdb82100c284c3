"""--real-time: with a factor, and without one."""

import pytest
import typer

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.cli.options import RealTimeFactor, with_factor


@pytest.mark.parametrize(
    ("arguments", "factor"),
    [
        ([], None),
        (["--real-time"], 1.0),
        (["--real-time", "10"], 10.0),
        (["--real-time=0.5"], 0.5),
        (["--real-time", "--seed", "7"], 1.0),
        (["--real-time", "2e1", "--seed", "7"], 20.0),
    ],
)
@pytest.mark.parametrize("scenario_first", [True, False])
def test_the_factor_is_1_where_none_is_given(arguments, factor, scenario_first) -> None:
    app, calls = typer.Typer(), []

    @app.command()
    def run(scenario: str, real_time: RealTimeFactor = None, seed: int = 0) -> None:
        calls.append((scenario, real_time))

    name = ["unicycles"]
    words = name + arguments if scenario_first else arguments + name
    app(with_factor(words), standalone_mode=False)
    assert calls == [("unicycles", factor)]


@pytest.mark.parametrize("factor", ["0", "-1", "1e4", "nan", "inf"])
@pytest.mark.parametrize(
    "command", [["run", "unicycles"], ["plant", "--scenario", "unicycles", "--run", "r"]]
)
def test_a_pace_at_which_time_would_not_go_on_is_refused(command, factor, capsys) -> None:
    assert status([*command, "--real-time", factor]) == USAGE_ERROR
    assert "expected more than 0 and at most 1000" in capsys.readouterr().err


def test_on_its_own_it_counts_as_given(capsys) -> None:
    asked = ["run", "unicycles", "--real-time", "--engine", "in-process"]
    assert status(asked) == USAGE_ERROR
    assert "expected no --view" in capsys.readouterr().err


def test_from_the_environment_it_is_for_engines_that_have_a_hub(tmp_path, monkeypatch) -> None:
    """And so are secrets."""
    monkeypatch.setenv("PHALANX_REAL_TIME", "1")
    monkeypatch.setenv("PHALANX_SECRET", "s")
    command = ["run", "one-on-one", "--engine", "in-process", "--set", "duration=0.1"]
    assert status([*command, "--no-report", "--out", str(tmp_path)]) == 0
