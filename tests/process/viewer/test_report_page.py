"""The report in a browser: what the first screen has, and how wide the page is."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from phalanx.report.write import write_report
from tests.unit.report.recordings import drift, record, summary_of, unicycles

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


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


def test_the_page_is_as_wide_as_the_screen(opened: "Tab") -> None:
    wide = opened.evaluate("document.documentElement.scrollWidth")
    assert wide == opened.viewport_size["width"]
