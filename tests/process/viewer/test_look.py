"""The page's look: most of it is the scene, in one font, and readable, by day and by night."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.page.page import Page

from tests.process.runs import wait_for
from tests.process.viewer.pages import served, set_display

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.swarm]

DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
LEAST_CONTRAST = 4.5
"""Of text and what is behind it (WCAG 2.2, 1.4.3)."""
TEXTS = """() => {
  const rgba = css => {
    const p = document.createElement("canvas").getContext("2d");
    p.fillStyle = css;
    p.fillRect(0, 0, 1, 1);
    return [...p.getImageData(0, 0, 1, 1).data].map(v => v / 255);
  };
  const over = ([r, g, b, a], below) => [r, g, b].map((v, k) => a * v + (1 - a) * below[k]);
  const luminance = rgb => rgb.map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = node => {
    if (!node) return rgba(getComputedStyle(document.body).backgroundColor).slice(0, 3);
    const fill = rgba(getComputedStyle(node).backgroundColor);
    return fill[3] === 1 ? fill.slice(0, 3) : over(fill, behind(node.parentElement));
  };
  const texts = [...document.querySelectorAll("body *")].filter(node =>
    node.getClientRects().length && node.ariaHidden !== "true" &&
    !["SCRIPT", "STYLE"].includes(node.tagName) &&
    [...node.childNodes].some(part => part.nodeType === 3 && part.data.trim()));
  return texts.map(node => {
    const style = getComputedStyle(node), back = behind(node);
    const [a, b] = [over(rgba(style.color), back), back].map(luminance);
    return { text: node.textContent.slice(0, 40), font: style.fontFamily,
      contrast: (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) };
  });
}"""
"""Each visible text of the page, with its font and its contrast."""


@pytest.fixture
def replayed(tab: "Tab", finished: Path) -> Iterator[Page]:
    """The page of a replay, which is in the tab."""
    with served(open_replay(finished)) as page:
        tab.set_viewport_size(DESK)
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.get_by_text("5 agents (2 adversaries)").wait_for()
        tab.locator("#phx-plots canvas").first.wait_for()
        yield page


def scene_share(tab: "Tab") -> float:
    """The scene's share of the page's width."""
    scene = tab.locator("#root canvas").first.bounding_box()
    assert scene is not None
    return scene["width"] / DESK["width"]


def test_the_scene_has_most_of_the_page_and_all_of_it_once_the_panels_are_folded(
    tab: "Tab", replayed: Page
) -> None:
    wait_for(lambda: 0.6 <= scene_share(tab) < 0.7)
    tab.get_by_role("button", name="plots", exact=True).click()
    wait_for(lambda: scene_share(tab) > 0.78)
    tab.locator(".tabler-icon-chevrons-left").click()
    wait_for(lambda: scene_share(tab) > 0.95)
    legend = tab.locator("#phx-legend").bounding_box()
    assert legend is not None
    middle = legend["x"] + legend["width"] / 2.0
    assert middle == pytest.approx(DESK["width"] / 2.0, abs=30.0), "it stays under the scene"


def shows_options(tab: "Tab") -> bool:
    """Unfold the display options; return whether they are there."""
    set_display(tab)
    return tab.get_by_text("Inputs", exact=True).is_visible()


def test_all_texts_are_of_one_font_and_readable(tab: "Tab", replayed: Page) -> None:
    titles = {"Inputs", "Legend", "Choose from the worst pair"}
    for scheme, size in (("light", DESK), ("light", PHONE), ("dark", PHONE), ("dark", DESK)):
        tab.set_viewport_size(size)
        set_display(tab, *(["Dark"] if (scheme, size) == ("dark", PHONE) else []))
        tab.locator(f"html[data-mantine-color-scheme={scheme}]").wait_for(state="attached")
        wait_for(lambda: shows_options(tab))  # another layout folds them again
        wait_for(lambda: titles <= {text["text"] for text in tab.evaluate(TEXTS)})
        texts = tab.evaluate(TEXTS)
        assert len({text["font"] for text in texts}) == 1
        faint = [text for text in texts if text["contrast"] < LEAST_CONTRAST]
        assert not faint


def test_the_legend_has_what_the_run_has_and_the_scene_shows(tab: "Tab", replayed: Page) -> None:
    legend = tab.locator("#phx-legend")
    legend.get_by_text("adversary").wait_for()
    for absent in ("late link", "lost link", "silent or dead", "unsafe", "false", "believed"):
        assert legend.get_by_text(absent).count() == 0
    set_display(tab, "Late and lost links", "Goals")
    legend.get_by_text("lost link").wait_for()
    legend.get_by_text("goal").wait_for(state="detached")
