"""Secrets on the command line: from the environment or a file, never from an argument."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import typer

from phalanx.wire.membership import COMMAND_SECRET, SECRET

_REFUSED = {"--secret": SECRET, "--command-secret": COMMAND_SECRET}


def refuse_secrets(arguments: Sequence[str]) -> None:
    """Refuse a secret among the arguments: every user of this host can read those."""
    for option in (argument.partition("=")[0] for argument in arguments):
        if option in _REFUSED:
            raise typer.BadParameter(
                f"{option}: every user of this host can read a program's arguments: make a new "
                f"secret, and give it in the environment, {_REFUSED[option]}, or in a file, "
                f"{option}-file"
            )


def secret_from(variable: str) -> Callable[[str], str]:
    """A callback: the secret in the file that the option names; without one the variable's."""

    def read(file: str) -> str:
        if not file:
            return os.environ.get(variable, "")
        try:
            secret = Path(file).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise typer.BadParameter(f"cannot be read: {error}") from error
        if not secret:
            raise typer.BadParameter(f"expected a secret in {file}, got nothing")
        return secret

    return read
