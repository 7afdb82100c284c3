"""The pages of the reference say on a code host, too, what there is: the names of today."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REFERENCE = runpy.run_path(str(ROOT / ".ci" / "reference.py"))
PAGES = sorted((ROOT / "docs" / "reference").glob("*.md"))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
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
