"""A visitor looks back at a run while it goes on, alone, and returns to the present."""

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from websockets.sync.client import connect

from phalanx.scenario.load import load
from tests.process.runs import HELD, live_run, wait_for
from tests.process.viewer.pages import Client, viewer, visitor

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = pytest.mark.swarm


def test_a_visitor_looks_back_while_the_run_goes_on_and_others_see_the_present(
    tmp_path: Path,
) -> None:
    with (
        live_run(load("unicycles", ["duration=30.0"]), tmp_path / "live", HELD) as run,
        viewer("--connect", run.endpoint, "--run", "live") as page,
    ):
        port = int(page.url.rpartition(":")[2])
        with (
            visitor(port) as first,
            visitor(port) as second,
            connect(f"ws://127.0.0.1:{port}/actions") as acting,
        ):
            ours, other = Client(first), Client(second)
            run.set_speed(0.2)
            ours.until(r"(t = 0\.[3-9]\d\d s)")
            ours.clicked, other.clicked = len(ours.received), len(other.received)
            acting.send(msgspec.json.encode({"visitor": ours.name, "seek": 0.1}))
            shown = float(ours.until(r"t = (0\.0[5-9]\d|0\.100) s.*looking back"))
            assert shown <= 0.1
            later = float(ours.until(r"now\W+(0\.[4-9]\d*)"))  # it goes on meanwhile
            assert later > shown
            other.until(r"(t = 0\.[4-9]\d\d s)")
            assert "looking back" not in other.received
            acting.send(msgspec.json.encode({"visitor": ours.name, "step": 1}))
            assert float(ours.until(r"t = (0\.1\d\d) s.*looking back")) > shown
            ours.clicked = len(ours.received)
            acting.send(msgspec.json.encode({"visitor": ours.name, "seek": 30.0}))
            ours.until(r"(t = [\d.]+ s.*× real time)")
            run.set_speed(0.0)
            run.summary()


@pytest.mark.browser
@pytest.mark.nightly
def test_the_page_of_a_live_run_says_that_it_looks_back_and_a_click_returns(
    tab: "Tab", tmp_path: Path
) -> None:
    with (
        live_run(load("unicycles", ["duration=20.0"]), tmp_path / "live", HELD) as run,
        viewer("--connect", run.endpoint, "--run", "live") as page,
    ):
        tab.goto(page.url)
        live = tab.get_by_role("button", name="● live")
        live.wait_for()
        run.set_speed(0.05)
        time = tab.locator("#phx-timeline output")
        wait_for(lambda: float(time.inner_text().removesuffix(" s")) > 0.1)
        tab.locator("body").press("Home")
        tab.get_by_text("looking back").wait_for()
        back = tab.get_by_role("button", name="▶ live,")
        wait_for(lambda: float(back.inner_text().split()[-2]) >= 0.1)
        back.evaluate("button => button.click()")
        live.wait_for()
        tab.get_by_text("× real time").wait_for()
        tab.locator("body").press("Space")
        tab.get_by_text("looking back").wait_for()
        tab.locator("body").press("End")
        live.wait_for()
        run.set_speed(0.0)
        run.summary()
