"""The page says at which speed a run goes, and offers those at which it can."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from phalanx.faults.commands import CommandPolicy
from phalanx.scenario.load import load
from tests.process.runs import COMMAND_SECRET, live_run, wait_for
from tests.process.viewer.pages import labelled, viewer

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.swarm, pytest.mark.nightly]

ADDRESS = "--run", "live", "--connect"


def choices(tab: "Tab") -> list[str]:
    """Open the list of speeds, and return them."""
    labelled(tab, "Speed").click()
    return tab.get_by_role("option").all_inner_texts()


def test_a_page_shows_the_speed_in_force_and_as_fast_as_possible_is_obeyed(
    tab: "Tab", tmp_path: Path
) -> None:
    slow = CommandPolicy(secret=COMMAND_SECRET, speed=0.02)
    with (
        live_run(load("unicycles", ["duration=9.0"]), tmp_path / "live", slow) as run,
        viewer(*ADDRESS, run.endpoint, command_secret=COMMAND_SECRET) as page,
    ):
        tab.goto(page.url)
        field = labelled(tab, "Speed")
        wait_for(lambda: field.input_value() == "0.02 ×")
        run.set_speed(0.1)
        wait_for(lambda: field.input_value() == "0.1 ×")
        assert choices(tab)[0] == "as fast as possible"
        tab.get_by_role("option", name="as fast as possible").click()
        assert run.summary().t == 9.0  # which would take a minute and a half at 0.1
