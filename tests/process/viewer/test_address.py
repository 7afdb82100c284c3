"""An address opens a run at a time with an agent chosen, and visitors choose their plots."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from phalanx_viewer.feeds.replay import Replay, open_replay
from phalanx_viewer.page.page import Page

from tests.process.runs import wait_for
from tests.process.viewer.pages import chosen, served

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.swarm]


@pytest.fixture
def replayed(finished: Path) -> Iterator[tuple[Replay, Page]]:
    """A replay and its page, without a visitor."""
    with served(replay := open_replay(finished)) as page:
        yield replay, page


def shows(replay: Replay, page: Page, t: float, agent: str) -> bool:
    """True if the page shows a time [s] with an agent chosen."""
    return abs(replay.t - t) < 1e-6 and chosen(page) == replay.model.names.index(agent)


def test_the_address_that_a_page_offers_opens_its_moment_and_holds_no_token(
    tab: "Tab", replayed: tuple[Replay, Page]
) -> None:
    replay, page = replayed
    url = f"http://127.0.0.1:{page.server.get_port()}/"
    tab.goto(f"{url}?token=secret#t=2.5&agent=3")
    wait_for(lambda: shows(replay, page, 2.5, "3"))
    shown = replay.frame(2.5).t  # of the last state before
    tab.get_by_text(f"t = {shown:.3f} s").wait_for()
    tab.get_by_role("button", name="link").click()
    note = tab.get_by_text("This moment: ")
    note.wait_for()
    offered = note.inner_text().removeprefix("This moment: ")
    assert offered == f"{url}#t={round(shown, 3):g}&agent=3"
    assert "?token=secret#t=" in tab.url  # its own visitor can go on commanding
    replay.seek(0.0)
    tab.goto("about:blank")
    wait_for(lambda: not page.visitors)
    tab.goto(offered)
    wait_for(lambda: shows(replay, page, round(shown, 3), "3"))


def test_an_address_of_another_run_says_what_is_wrong_with_it(
    tab: "Tab", replayed: tuple[Replay, Page]
) -> None:
    replay, page = replayed
    tab.goto(f"http://127.0.0.1:{page.server.get_port()}/#t=1.5&agent=9")
    tab.get_by_text("The run has no agent 9: it has 1, 2, 3, 4, 5.").wait_for()
    wait_for(lambda: shows(replay, page, 1.5, "1"))
    tab.evaluate("location.hash = '#t=soon&agent=2'")
    tab.get_by_text("Expected a time in seconds, such as #t=12.3, got t=soon.").wait_for()
    wait_for(lambda: shows(replay, page, 1.5, "2"))
    tab.evaluate("location.hash = '#t=1e9'")
    wait_for(lambda: shows(replay, page, replay.end, "2"))


def test_a_visitor_chooses_the_plots_and_z_brings_back_its_own(
    tab: "Tab", replayed: tuple[Replay, Page]
) -> None:
    replay, page = replayed
    tab.goto(f"http://127.0.0.1:{page.server.get_port()}/#t=1")
    headings = tab.locator("#phx-plots .phx-title[aria-expanded=true]")
    diagram = "Late, lost, false; backup, silence"
    headings.get_by_text("Smallest distance").wait_for()
    before = headings.all_inner_texts()
    for title in ("Smallest distance", diagram):
        headings.get_by_text(title).evaluate("title => title.click()")
    wait_for(lambda: len(headings.all_inner_texts()) == len(before) - 2)
    assert tab.locator("#phx-plots canvas:visible").count() == len(before) - 2
    assert set(before) - {*headings.all_inner_texts()} == {"Smallest distance [m]", diagram}
    tab.keyboard.press("End")  # a title does not keep the keys
    wait_for(lambda: replay.t == replay.end)
    tab.keyboard.press("z")
    headings.get_by_text(diagram).wait_for()
    assert headings.get_by_text("Smallest distance").count() == 0
