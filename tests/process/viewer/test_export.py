"""A run exported to share: opened from disk, without a network."""

import base64
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from phalanx_viewer.export.write import run
from zstandard import ZstdDecompressor

from phalanx.recording.read import read
from tests.process.runs import wait_for
from tests.process.viewer.pages import pixels

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]


@pytest.fixture
def offline(browser: "Browser") -> Iterator["Tab"]:
    """A tab without a network; what it asked for is in `asked`."""
    context = browser.new_context(offline=True, viewport={"width": 900, "height": 600})
    opened = context.new_page()
    opened.set_default_timeout(120_000)  # it draws in software, on whatever cores are left
    yield opened
    context.close()


@pytest.mark.browser
def test_the_exported_page_plays_its_scene_and_moves_its_plots_offline(
    offline: "Tab", finished: Path, tmp_path: Path
) -> None:
    requests: list[str] = []
    offline.on("request", lambda request: requests.append(request.url))
    html = tmp_path / "run.html"
    assert run(read(finished), html=html) == [html]
    offline.goto(html.as_uri())
    assert not offline.get_by_text("Smallest distance [m]").is_visible()  # the page is narrow
    offline.get_by_role("button", name="plots").click()
    offline.get_by_text("Smallest distance [m]").wait_for()
    slider = offline.locator("#root [role=slider]").first
    slider.wait_for(state="attached")
    plot = offline.locator("#phx-plots canvas").first
    before, started = pixels(plot), slider.get_attribute("aria-valuenow")
    wait_for(lambda: slider.get_attribute("aria-valuenow") != started)
    wait_for(lambda: pixels(plot) != before)
    offline.locator("#phx-agent").select_option("Agent 5")
    offline.get_by_text("Control step [ms], agent 5").wait_for()
    offline.keyboard.press("Home")
    wait_for(lambda: slider.get_attribute("aria-valuenow") == "0")
    for key, frame in ((".", 1), (".", 2), (".", 3), (",", 2), ("End", 120), (",", 119)):
        offline.keyboard.press(key)
        at = f"{frame / 30:.3f}"  # a film has a frame each thirtieth of a second
        wait_for(lambda at=at: f"{float(slider.get_attribute('aria-valuenow')):.3f}" == at)
    offline.keyboard.press("Home")
    wait_for(lambda: slider.get_attribute("aria-valuenow") == "0")
    offline.keyboard.press("Space")
    wait_for(lambda: slider.get_attribute("aria-valuenow") != "0")
    offline.goto("about:blank")
    offline.goto(f"{html.as_uri()}#t=2&agent=3")
    wait_for(lambda: float(slider.get_attribute("aria-valuenow") or 0) == 2.0)
    assert offline.locator("#phx-agent").input_value() == "Agent 3"
    assert not [url for url in requests if url.startswith(("http", "ws"))]


def texts_of(page: str) -> set[str]:
    """The texts that labels of an exported scene show at some time."""
    (data,) = re.findall(r'__VISER_EMBED_DATA__="([^"]+)"', page)
    film = ZstdDecompressor().decompressobj().decompress(base64.b64decode(data)[8:])
    length = int.from_bytes(film[:8], "little")
    messages = msgspec.msgpack.decode(film[8 : 8 + length])["messages"]
    return {text for _, each in messages if (text := each.get("updates", {}).get("text"))}


@pytest.mark.browser
@pytest.mark.parametrize("size", [(1280, 800), (390, 844)], ids=["desk", "phone"])
def test_the_exported_page_has_verdict_legend_and_names(
    offline: "Tab", finished: Path, tmp_path: Path, size: tuple[int, int]
) -> None:
    html, recorded = tmp_path / "run.html", read(finished)
    run(recorded, html=html)
    assert {"1", "2", "3", "4", "5"} <= texts_of(html.read_text("utf-8"))
    offline.set_viewport_size({"width": size[0], "height": size[1]})
    offline.goto(html.as_uri())
    head, legend = offline.locator("#phx-run"), offline.locator("#phx-legend")
    head.get_by_text(f"{recorded.summary.outcome}: ").wait_for()
    if size[0] < 576:
        legend.get_by_text("Legend").click()  # it is folded
    for entry in ("adversary", "circles touch where h = 0", "nominal input"):
        assert legend.get_by_text(entry).is_visible()
    for entry in ("late link", "unsafe", "chosen agent", "height over the ground"):
        assert legend.get_by_text(entry).count() == 0, "a film of this run does not have it"
    parts = [head, legend, offline.locator("#phx-timeline")]
    top, *others = [part.bounding_box() for part in parts]
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= size[0] for box in (top, *others))
    for box in others:  # one under the other
        assert top["y"] + top["height"] <= box["y"]
        top = box
    scene = offline.locator("#root").bounding_box()
    assert scene["width"] >= 0.99 * scene["height"], "else agents at the sides are cut off"
