"""Help texts: what a source file says reaches the terminal whole."""

import pytest
from rich.text import Text
from typer.main import get_command

from phalanx.cli.app import core, extended

TOP = get_command(extended()).commands
COMMANDS = TOP | TOP["network"].commands | TOP["fit"].commands


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_word_of_a_help_text_is_taken_for_markup(name):
    command = COMMANDS[name]
    for text in (command.help, *(getattr(option, "help", None) for option in command.params)):
        assert Text.from_markup(text or "").plain == (text or "")


def test_the_core_stands_first_and_extensions_follow_in_the_order_of_their_names():
    ours = list(get_command(core()).commands)
    assert [name for name in TOP if name in ours] == ours
    assert [name for name in TOP if name not in ours] == [
        "attack", "keys", "router", "report", "compare", "animate",
        "shrink", "replay", "study", "view", "export", "viewer",
        "certify", "ros2",
    ]  # fmt: skip
