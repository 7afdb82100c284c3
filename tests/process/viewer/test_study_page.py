"""The page of a study in a browser: rows are sorted by a click, and colours follow the reader's."""

from pathlib import Path

import pytest
from phalanx_studies.page.write import write_study_page

from tests.synthetic_studies import frame

pytestmark = pytest.mark.browser


@pytest.fixture
def written(tmp_path: Path) -> str:
    rows = [
        {"seed": i, "worst_h": h, "worst_pair": pair, "outcome": "safe"}
        for i, (h, pair) in enumerate([(-2.0, "b"), (1e-5, "a"), (None, ""), (-10.0, "c")])
    ]
    return write_study_page(frame(rows), [], "s", tmp_path / "s.html", lambda _: "x").as_uri()


def column(tab, name: str) -> list[str]:
    """The cells under a title of the table of rows."""
    return tab.evaluate(
        """name => {
          const rows = [...document.querySelectorAll("table.sortable tr")]
            .map(row => [...row.cells].map(cell => cell.textContent))
          return rows.slice(1).map(row => row[rows[0].indexOf(name)])
        }""",
        name,
    )


def test_a_click_on_a_title_sorts_and_another_turns_the_order(tab, written):
    tab.goto(written)
    assert column(tab, "worst_h") == ["1e-05", "-2", "-10", "–"]
    tab.get_by_role("button", name="worst_h").click()
    assert column(tab, "worst_h") == ["-10", "-2", "1e-05", "–"]
    tab.get_by_role("button", name="worst_h").click()
    assert column(tab, "worst_h") == ["1e-05", "-2", "-10", "–"]
    tab.get_by_role("button", name="worst_pair").press("Enter")
    assert column(tab, "worst_pair") == ["a", "b", "c", "–"]
    assert column(tab, "index") == ["1", "0", "3", "2"]
