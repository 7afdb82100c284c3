"""The command without a subcommand."""

import phalanx
from phalanx.cli.app import USAGE_ERROR, status


def test_version_is_told(capsys):
    assert status(["--version"]) == 0
    assert capsys.readouterr().out == f"phalanx {phalanx.__version__}\n"


def test_an_unknown_command_is_refused_with_where_to_look(capsys):
    assert status(["walk"]) == USAGE_ERROR
    assert "phalanx --help" in capsys.readouterr().err
