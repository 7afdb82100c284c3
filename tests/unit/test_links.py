"""Every link in the project's pages leads somewhere, and every path that they name exists.

The docs site checks its own links when it is built; this needs neither site nor network, and takes
in the pages at the top.
"""

import re
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_shows_a_file_by_a_line_that_the_site_reads(page):
    """Ruff formats a line that includes a file, in a block of Python, into one that does not."""
    lines = [line for line in page.read_text(encoding="utf-8").splitlines() if "--8" in line]
    assert all(re.fullmatch(r'--8<-- "[\w./-]+"', line) for line in lines)
