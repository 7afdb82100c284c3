"""Inputs that an agent holds are drawn as held."""

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from phalanx_viewer.feeds.replay import open_replay

import phalanx
from tests.process.viewer.pages import served

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.nightly]

DRAWN_ANEW = """
async () => {
  const pen = CanvasRenderingContext2D.prototype, { beginPath, lineTo, stroke } = pen;
  const plots = new Map();
  let path;
  pen.beginPath = function () { path = []; beginPath.call(this); };
  pen.lineTo = function (x, y) { path.push([x, y]); lineTo.call(this, x, y); };
  pen.stroke = function () {
    if (this.lineWidth > 1.5) plots.set(this.canvas, path);
    stroke.call(this);
  };
  dispatchEvent(new Event("resize"));
  await new Promise(then => requestAnimationFrame(() => setTimeout(then)));
  Object.assign(pen, { beginPath, lineTo, stroke });
  return [...plots.values()];
}
"""
"""The chosen curve of each plot, as the points through which it is drawn [pixels]."""


def test_a_dead_robots_input_is_a_step_until_it_is_back_and_then_to_the_end(
    tab: "Tab", tmp_path: Path
) -> None:
    scenario = phalanx.load("faults/restart")
    run = phalanx.run(scenario, engine="in-process", out=tmp_path)
    with served(replay := open_replay(run.folder)) as page:
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.locator("#phx-plots h2", has_text="and nominal").first.wait_for()
        titles = tab.locator("#phx-plots .phx-title").all_inner_texts()
        curves = tab.evaluate(DRAWN_ANEW)
        curve_of = dict(zip(titles, curves, strict=False))  # the lanes have no curve
        right = max(x for points in curves for x, _ in points)
        for title in (title for title in titles if ", agent 1" in title and title in curve_of):
            points = curve_of[title]
            slants = [(a, b) for a, b in pairwise(points) if a[0] < b[0] and a[1] != b[1]]
            assert not slants, title
            if title.startswith("Input"):
                assert points[-1][0] == pytest.approx(right)
        assert any(title.startswith("Input") for title in curve_of)
        assert replay.end == 1.0
