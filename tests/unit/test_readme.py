"""The first screen: short, with a picture and two commands; and an index of all pages."""

import ast
import re
from pathlib import Path

import phalanx

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text("utf-8")
SCREEN = 30
"""Lines that a code host shows at once."""


def words(text: str) -> list[str]:
    return [word for word in text.split() if re.search(r"\w", word)]


def test_the_readme_is_of_at_most_350_words():
    assert len(words(TEXT)) <= 350


def test_its_first_screen_says_what_it_is_with_a_picture_and_two_commands_of_make():
    screen = "\n".join(TEXT.splitlines()[:SCREEN])
    assert "?**" in screen, "the question"
    (picture,) = re.findall(r'<img src="([^"]+)"', screen)
    assert (ROOT / picture).is_file()
    rules = (ROOT / "Makefile").read_text("utf-8")
    commands = re.findall(r"^make (\w+)", screen, re.MULTILINE)
    assert commands == ["run", "test"]
    assert all(f"\n{rule}:" in rules for rule in commands)


def test_what_it_says_a_verdict_means_is_said_of_each():
    assert set(re.findall(r"^\| \*\*(\w+)\*\*", TEXT, re.MULTILINE)) == {
        outcome for outcome in phalanx.Outcome if outcome not in ("broken", "stopped")
    }


def test_what_follows_an_installation_needs_no_more_than_that_brings():
    """The page needs `view`, data frames and studies `lab`."""
    before_view, _, after_view = TEXT.partition("pip install '.[view]'")
    assert "--view" not in before_view
    assert "--view" in after_view
    before_lab, _, after_lab = TEXT.partition("pip install '.[lab]'")
    assert not {"run.h", "phalanx.study"} & set(re.findall(r"[\w.]+", before_lab))
    assert "phalanx.study" in after_lab


def test_its_python_names_only_what_is_public():
    (source,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    nodes = list(ast.walk(ast.parse(source)))
    names = {
        node.attr
        for node in nodes
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "phalanx"
    }
    assert names
    assert names <= set(phalanx.__all__)
    assert len(source.splitlines()) <= 10


def test_the_index_leads_to_every_page():
    index = (ROOT / "docs" / "index.md").read_text("utf-8")
    pages = {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"}
    assert pages - set(re.findall(r"\]\(([\w.-]+\.md)", index)) == set()
