"""The report in a browser: what the first screen has, how tables scroll, and where words break."""

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

import matplotlib.image
import numpy as np
import pytest

from phalanx.report.write import write_report
from tests.unit.report.recordings import drift, record, summary_of, unicycles

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.nightly]

_SPLIT = """() => {
  const split = [], range = document.createRange();
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const node = texts.currentNode;
    if (/^[0-9a-f]{64}$/.test(node.data)) continue;  // a digest is no word
    if (node.parentElement.closest("details, script, style, pre")) continue;
    for (const word of node.data.matchAll(/[\\p{L}\\d_]+/gu)) {
      range.setStart(node, word.index);
      range.setEnd(node, word.index + word[0].length);
      if (new Set([...range.getClientRects()].map(box => box.top)).size > 1) split.push(word[0]);
    }
  }
  return split;
}"""
"""Words whose letters are on several lines."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    scenario = unicycles("network.loss=0.3")
    folder = tmp_path_factory.mktemp("run")
    return write_report(record(folder, scenario, drift(scenario), summary_of(scenario))).as_uri()


@pytest.fixture(params=[(1280, 800), (390, 844)], ids=["desk", "phone"])
def opened(browser: "Browser", page: str, request: pytest.FixtureRequest) -> Iterator["Tab"]:
    width, height = request.param
    tab = browser.new_page(viewport={"width": width, "height": height})
    tab.goto(page)
    tab.wait_for_function("[...document.images].every(image => image.complete)")
    yield tab
    tab.close()


def test_verdict_and_a_whole_figure_are_on_the_first_screen(opened: "Tab") -> None:
    height = opened.viewport_size["height"]
    for part in (opened.locator(".verdict"), opened.locator("figure img").first):
        box = part.bounding_box()
        assert 0 <= box["y"] < box["y"] + box["height"] <= height


def test_the_page_is_as_wide_as_the_screen_and_breaks_no_word(opened: "Tab") -> None:
    wide = opened.evaluate("document.documentElement.scrollWidth")
    assert wide == opened.viewport_size["width"]
    assert opened.evaluate(_SPLIT) == []


def test_a_link_of_the_contents_leads_to_its_section(opened: "Tab") -> None:
    opened.get_by_role("navigation").get_by_role("link", name="Events").click()
    assert opened.get_by_role("heading", name="Events").bounding_box()["y"] < 844


def test_a_table_has_a_shadow_on_the_side_where_it_goes_on(opened: "Tab") -> None:
    tables = opened.locator(".wide")
    sizes = tables.evaluate_all("all => all.map(each => each.scrollWidth - each.clientWidth)")
    for table, hidden in zip(tables.all(), sizes, strict=True):
        if hidden == 0:
            assert edges(table) == (False, False)
        elif hidden > 32:  # over less than its own width a shadow fades
            assert edges(table) == (False, True)
            table.evaluate("each => { each.scrollLeft = each.scrollWidth; }")
            assert edges(table) == (True, False)
    assert opened.viewport_size["width"] > 390 or max(sizes) > 50


def edges(table: "Locator") -> tuple[bool, bool]:
    """Return whether the left and the right edge of a table are darker than its middle."""
    png = io.BytesIO(table.screenshot())
    grey = matplotlib.image.imread(png, format="png")[..., :3].mean(axis=2)
    left, right, inside = (np.median(part) for part in (grey[:, 0], grey[:, -1], grey[:, 30:-30]))
    return bool(left < inside - 0.1), bool(right < inside - 0.1)
