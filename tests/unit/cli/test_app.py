"""The command without a subcommand, what it imports and when, and its help texts."""

import resource
import subprocess
import sys

import pytest
import typer
from rich.text import Text
from typer.main import get_command

import phalanx
from phalanx.cli.app import USAGE_ERROR, core, extended, status
from phalanx.cli.jobs import Job
from phalanx.cli.options import RealTimeFactor, with_factor
from phalanx.launcher import libraries


def test_version_is_printed(capsys):
    assert status(["--version"]) == 0
    assert capsys.readouterr().out == f"phalanx {phalanx.__version__}\n"


def test_an_unknown_command_is_refused_with_where_to_look(capsys):
    assert status(["walk"]) == USAGE_ERROR
    assert "phalanx --help" in capsys.readouterr().err


@pytest.mark.slow
def test_what_takes_long_to_import_is_imported_by_the_commands_that_need_it():
    heavy = ("casadi", "cryptography", "numpy", "polars", "pydantic", "scipy", "viser", "zenoh")
    loaded = f"import sys, phalanx.cli.app; print(sorted(set({heavy}) & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", loaded], capture_output=True, check=True, text=True)
    assert out.stdout == "[]\n"


@pytest.mark.slow
@pytest.mark.parametrize("program", ["plant", "agent"])
def test_a_program_of_a_run_starts_without_libraries_of_other_commands(program):
    others = ("matplotlib", "polars", "scipy", "viser")
    loaded = f"import sys, phalanx_{program}.main; print(sorted(set({others}) & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True)
    assert found.stdout == "[]\n", found.stderr


TOP = get_command(extended()).commands
COMMANDS = TOP | TOP["fit"].commands


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_word_of_a_help_text_is_taken_for_markup(name):
    command = COMMANDS[name]
    for text in (command.help, *(getattr(option, "help", None) for option in command.params)):
        assert Text.from_markup(text or "").plain == (text or "")


def test_commands_stand_by_job_and_of_each_the_core_first():
    ours = get_command(core()).commands
    names = [name for name in TOP if name != "fit"]  # a group of commands stands last
    places = [([*Job].index(TOP[name].rich_help_panel), name not in ours) for name in names]
    assert places == sorted(places)
    assert [job for job in Job if job not in {TOP[name].rich_help_panel for name in names}] == [
        Job.PACKAGES
    ]


_LIMIT = 2**46
"""Above all that a process may ever need, so that it limits nothing here."""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """One entry for each time that libraries were to be loaded."""
    found: list[None] = []
    monkeypatch.setattr(libraries, "start_loading", lambda: found.append(None))
    return found


@pytest.fixture
def little_memory():
    """A limit on this process's memory."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.skipif(resource.getrlimit(resource.RLIMIT_AS)[0] > 0, reason="memory has a limit")
@pytest.mark.parametrize(("engine", "times"), [("processes", 1), ("in-process", 0)])
def test_libraries_are_loaded_ahead_for_processes_alone(asked: list[None], engine, times):
    assert status(["run", "nobody", "--engine", engine]) == USAGE_ERROR
    assert len(asked) == times


@pytest.mark.usefixtures("little_memory")
def test_where_memory_has_a_limit_no_process_loads_libraries_on_its_own(asked: list[None]):
    """Out of memory it would die in words of its own."""
    assert status(["run", "nobody"]) == USAGE_ERROR
    assert asked == []


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
