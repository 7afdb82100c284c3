"""Pages lead somewhere and name what exists; the README is a first screen, all names are there."""

import ast
import re
import runpy
from pathlib import Path

import pytest

import phalanx

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
FOLDERS = "agent|bench|docs|evidence|examples|phalanx|plant|scenarios|tests|viewer"
PATH = re.compile(rf"(?<![\w./])(?:{FOLDERS})/[\w./-]*")


def anchors(page: Path) -> set[str]:
    """The ids of a page's headings, as the site and code hosts make them."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


def broken(page: Path) -> list[str]:
    """Links of a page to files or headings that do not exist."""
    mistakes = []
    for target in LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            mistakes.append(target)
    return mistakes


def missing(page: Path) -> list[str]:
    """Paths of the project that a page names and that do not exist."""
    code = CODE.findall(FENCE.sub("", page.read_text(encoding="utf-8")))
    return [path for text in code for path in PATH.findall(text) if not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    assert broken(page) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_path_that_a_page_names_exists(page):
    assert missing(page) == []


def test_a_broken_link_is_found(tmp_path):
    (tmp_path / "a.md").write_text("# One, two\n[here](#one-two) [file](b.md) [gone](#three)\n")
    (tmp_path / "b.md").write_text("[back](a.md#one-two) [gone](a.md#two)\n```\n[x](y)\n```\n")
    assert broken(tmp_path / "a.md") == ["#three"]
    assert broken(tmp_path / "b.md") == ["a.md#two"]


def test_a_path_that_is_gone_is_found(tmp_path):
    (tmp_path / "a.md").write_text("`phalanx/wire/` `python bench/gone.py --seeds 2` `runs/a`\n")
    assert missing(tmp_path / "a.md") == ["bench/gone.py"]


TEXT = (ROOT / "README.md").read_text("utf-8")
SCREEN = 30
"""Lines that a code host shows at once."""


def test_the_readme_is_of_at_most_350_words():
    assert len(re.findall(r"\S*\w\S*", TEXT)) <= 350


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
    names = {
        node.attr
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "phalanx"
    }
    assert names
    assert names <= {*phalanx.__all__, *phalanx.OF_PACKAGES}
    assert len(source.splitlines()) <= 10


def test_the_index_leads_to_every_page():
    index = (ROOT / "docs" / "index.md").read_text("utf-8")
    pages = {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"}
    assert pages - set(re.findall(r"\]\(([\w.-]+\.md)", index)) == set()


REFERENCE = runpy.run_path(str(ROOT / ".ci" / "reference.py"))
REFERENCE_PAGES = sorted((ROOT / "docs" / "reference").glob("*.md"))


def test_pages_show_files_as_they_are():
    texts = {page: page.read_text("utf-8") for page in PAGES}
    shown = [page for page, text in texts.items() if REFERENCE["SHOWN"].search(text)]
    assert len(shown) == 4
    assert [page for page in shown if REFERENCE["with_files"](texts[page]) != texts[page]] == []


@pytest.mark.slow
@pytest.mark.parametrize("page", REFERENCE_PAGES, ids=lambda page: page.stem)
def test_a_page_lists_the_names_of_its_modules(page: Path):
    text = page.read_text("utf-8")
    assert text == REFERENCE["with_names"](text), "else: python .ci/reference.py"
    lines = text.partition(REFERENCE["BEGIN"])[2].partition(REFERENCE["END"])[0].strip().split("\n")
    assert len(lines) > 1
    assert all(line.startswith("- `") and ": " in line for line in lines)


def test_a_first_sentence_ends_before_the_next_and_is_plain_markdown():
    sentence = REFERENCE["sentence"]
    assert sentence("A box, Eq. (3).\nThe rest.") == "A box, Eq. (3)."
    assert sentence("A box of a_b* in\n``code``\n\nMore.") == "A box of `a_b`* in `code`"
    assert sentence(None) == ""
