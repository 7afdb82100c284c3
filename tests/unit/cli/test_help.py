"""Help texts: what a source file says reaches the terminal whole."""

import pytest
from rich.text import Text
from typer.main import get_command

from phalanx.cli.app import app

TOP = get_command(app).commands
COMMANDS = TOP | TOP["network"].commands


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_word_of_a_help_text_is_taken_for_markup(name):
    command = COMMANDS[name]
    for text in (command.help, *(getattr(option, "help", None) for option in command.params)):
        assert Text.from_markup(text or "").plain == (text or "")
