"""The command without a subcommand."""

import subprocess
import sys

import pytest

import phalanx
from phalanx.cli.app import USAGE_ERROR, status


def test_version_is_told(capsys):
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
