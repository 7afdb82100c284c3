"""A working scenario file, and ways to break it."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from phalanx.scenario.load import ScenarioError, load, shipped

Edit = Callable[[str], str]
Broken = tuple[str, Edit, list[str]]
"""What is wrong, the edit that makes it so, and fragments of the message."""


@cache
def working() -> str:
    """Simulation 1 as it is shipped."""
    return shipped()["unicycles"].read_text(encoding="utf-8")


def replace(old: str, new: str, count: int = 1) -> Edit:
    """Put something else in the place of a text that must be there."""

    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, count)

    return edit


def under(header: str, line: str) -> Edit:
    """Add a line below a table's header."""
    return replace(header, f"{header}\n{line}")


def written(text: str, folder: Path) -> str:
    """The path of a file with this text."""
    path = folder / "broken.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def assert_refused(edit: Edit, fragments: list[str], folder: Path) -> None:
    """The edited file is refused: every line names the file, and each fragment is in it."""
    path = written(edit(working()), folder)
    with pytest.raises(ScenarioError) as error:
        load(path)
    assert all(line.startswith(f"{path}: ") for line in str(error.value).splitlines())
    for fragment in fragments:
        assert fragment in str(error.value)
