"""Visitors' views and actions, in a real browser on real runs."""

import math
import os
import re
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from phalanx_explain.explanation import explain
from phalanx_viewer.feeds.replay import Replay, open_replay
from phalanx_viewer.page.page import Page
from phalanx_viewer.plots.plots import content

import phalanx
from phalanx.guarantee.verdict import Assumption, Outcome, Violation
from phalanx.recording.read import read
from phalanx.recording.records import RECORDING, Log
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
from tests.process.runs import HELD, live_run, wait_for
from tests.process.viewer.pages import chosen, labelled, pixels, served, set_display, viewer

if TYPE_CHECKING:
    from playwright.sync_api import Locator
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.swarm]

STATUS = re.compile(r"t = ([\d.]+) s of")


def time_shown(tab: "Tab") -> float:
    """The virtual time that the page shows."""
    status = STATUS.search(tab.locator("body").inner_text())
    return float(status.group(1)) if status else math.nan


def click_at(tab: "Tab", canvas: "Locator", share: float) -> None:
    """Click where a canvas shows this share of the run."""
    margin_left, margin_right = (
        (44, 8) if "phx-plots" in canvas.evaluate("c => c.parentNode.id") else (8, 8)
    )
    box = canvas.bounding_box()
    assert box is not None
    across = margin_left + share * (box["width"] - margin_left - margin_right)
    canvas.click(position={"x": across, "y": box["height"] / 2.0})


@pytest.fixture
def replayed(tab: "Tab", finished: Path) -> Iterator[tuple[Replay, Page]]:
    """A replay, and its page, which is in the tab."""
    with served(replay := open_replay(finished)) as page:
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.locator("#phx-plots canvas").first.wait_for()
        yield replay, page


@pytest.mark.nightly
def test_a_click_on_a_plot_or_on_the_timeline_moves_the_run_there(
    tab: "Tab", finished: Path
) -> None:
    with viewer(str(finished)) as page:
        tab.goto(page.url)
        tab.get_by_text("5 agents (2 adversaries)").wait_for()
        wait_for(lambda: time_shown(tab) == 0.0)
        plot = tab.locator("#phx-plots canvas").first
        value = tab.locator("#phx-plots h2", has_text="h_tot").locator("output")
        wait_for(lambda: f"h_tot {float(value.inner_text()):.2f}" in tab.inner_text("body"))
        before = pixels(plot)
        click_at(tab, plot, 0.5)
        wait_for(lambda: abs(time_shown(tab) - 2.0) < 0.05)
        wait_for(lambda: pixels(plot) != before)
        click_at(tab, tab.locator("#phx-timeline canvas"), 0.75)
        wait_for(lambda: abs(time_shown(tab) - 3.0) < 0.05)
        tab.get_by_role("button", name="worst", exact=True).click()
        recording = read(finished)
        worst = float(recording.times[int(np.argmax(recording.h))])
        wait_for(lambda: abs(time_shown(tab) - worst) < 0.002)
        tab.get_by_text("Certified for [τ], agent 1").wait_for()
        assert tab.get_by_text("Command", exact=True).count() == 0


@pytest.mark.nightly
def test_the_keyboard_plays_pauses_and_moves_the_cursor(tab: "Tab", replayed) -> None:
    replay, _ = replayed
    tab.keyboard.press("End")
    wait_for(lambda: time_shown(tab) == round(replay.end, 3))
    tab.keyboard.press("Shift+ArrowLeft")
    wait_for(lambda: time_shown(tab) == pytest.approx(replay.end * (1.0 - 10 / 500), abs=0.01))
    tab.keyboard.press("Home")
    wait_for(lambda: time_shown(tab) == 0.0)
    tab.keyboard.press("Shift+ArrowRight")
    wait_for(lambda: time_shown(tab) == pytest.approx(replay.end * 10 / 500, abs=0.01))
    stepped = replay.times[np.searchsorted(replay.times, replay.t, side="right")]
    tab.keyboard.press(".")
    wait_for(lambda: replay.t == stepped)
    tab.keyboard.press("Space")
    wait_for(lambda: replay.playing)
    tab.keyboard.press("Space")
    wait_for(lambda: not replay.playing)


@pytest.mark.nightly
def test_an_agents_name_and_enter_choose_it_and_the_keys_move_the_cursor_again(
    tab: "Tab", tmp_path: Path
) -> None:
    out = phalanx.run(load("swarm2d", ["duration=0.1"]), engine="in-process", out=tmp_path)
    with served(replay := open_replay(out.folder)) as page:
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        field = labelled(tab, "Agent")
        for typed, name in (("11", "11"), ("1", "1"), ("nobody", "1"), ("6", "6")):
            field.click()
            field.fill(typed)
            field.press("Enter")
            wait_for(lambda name=name: chosen(page) == replay.model.names.index(name))  # type: ignore[misc]
        field.click()
        tab.get_by_role("option", name="7", exact=True).click()
        wait_for(lambda: chosen(page) == replay.model.names.index("7"))
        tab.keyboard.press("End")
        wait_for(lambda: replay.t == replay.end)


@pytest.mark.nightly
def test_everything_sent_to_a_visitor_is_sent_from_the_servers_thread(
    tab: "Tab", finished: Path
) -> None:
    before = set(threading.enumerate())
    with served(replay := open_replay(finished)) as page:
        # A loop that debugs refuses to be touched from another thread. Otherwise it goes wrong
        # when the loop happens to be doing the same: "deque mutated during iteration".
        page.server.get_event_loop().set_debug(True)
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.locator("#phx-plots canvas").first.wait_for()
        set_display(tab, "Dark", "Late and lost links", "Inputs", "Recent paths", "Goals")
        for name in ("Fit the view", "Choose from the worst pair"):
            tab.get_by_role("button", name=name).click()
        worst = replay.model.swarm.safe_set.pairs[replay.frame(0.0).pair].a
        wait_for(lambda: chosen(page) == worst)
        tab.keyboard.press("End")
        wait_for(lambda: time_shown(tab) == round(replay.end, 3))
        added = {thread.name for thread in threading.enumerate() if thread not in before}
        assert not any(name.startswith("ThreadPoolExecutor") for name in added)  # viser's own


@pytest.mark.nightly
def test_the_space_time_diagram_shows_the_worst_moment_in_detail(tab: "Tab", replayed) -> None:
    replay, _ = replayed
    diagram = content(replay, range(5), seekable=True).plots[-1].zoom
    assert diagram is not None
    tab.get_by_role("button", name="worst moment (z)").wait_for()
    canvas = tab.locator("#phx-plots canvas").last
    whole = pixels(canvas)
    tab.keyboard.press("z")
    wait_for(lambda: pixels(canvas) != whole)
    click_at(tab, canvas, 0.5)
    middle = (diagram.begin + diagram.end) / 2.0
    wait_for(lambda: replay.t == pytest.approx(middle, abs=0.01 * (diagram.end - diagram.begin)))
    tab.get_by_role("button", name="whole run (z)").click()
    click_at(tab, canvas, 0.25)
    wait_for(lambda: replay.t == pytest.approx(0.25 * replay.end, abs=0.05))


@pytest.mark.nightly
def test_the_page_of_a_live_run_goes_on_with_its_replay(tab: "Tab", tmp_path: Path) -> None:
    with live_run(load("unicycles", ["duration=3.0"]), tmp_path / "live", HELD) as run:
        wait_for((run.folder / "live.json").exists)
        with viewer(str(run.folder)) as page:
            tab.goto(page.url)
            tab.get_by_text("× real time").wait_for()
            tab.evaluate("window.sameVisit = true")
            assert not tab.locator("#phx-timeline select").is_visible()
            run.set_speed(0.0)
            tab.locator("#phx-timeline select").wait_for()
            wait_for(lambda: time_shown(tab) == 3.0)
            last = tab.locator("body").inner_text()
            tab.keyboard.press("Home")
            wait_for(lambda: time_shown(tab) == 0.0)
            first = open_replay(run.folder).frame(0.0)
            assert f"{first.steps} steps" in tab.locator("body").inner_text()
            assert f" {first.steps} steps" not in last
            assert tab.evaluate("window.sameVisit")


RUNS_CODE = (
    "<img src=x onerror='owned=1'><iframe srcdoc='<script>parent.owned=1</script>'></iframe>"
)
HOSTILE = f"{RUNS_CODE} {{owned=1}} **bold** [link](javascript:owned=1) ![](http://evil.example/x)"


def test_text_of_a_recording_is_text_on_the_page(
    tab: "Tab", finished: Path, tmp_path: Path
) -> None:
    recording = read(finished)
    assert recording.summary is not None
    os.mkfifo(fifo := tmp_path / "fifo")
    spoken = f"{HOSTILE} ![]({fifo}) ![](/etc/hostname)"
    with RecordingWriter(tmp_path / RECORDING, recording.scenario, spoken) as writer:
        for record in [*recording.states, *recording.steps]:
            writer.write(record)
        writer.write(Log(0.0, f"log {spoken}"))
        writer.finish(
            msgspec.structs.replace(
                recording.summary,
                outcome=Outcome.VIOLATED,
                reason=f"reason {spoken}",
                assumptions=[Assumption(f"name {spoken}", 1, 2, 0.0, f"note {spoken}")],
                violations=[Violation(f"pair {spoken}", 0.0, 0.25, 0.3, 0.15, 1, 0.0, None)],
            )
        )
    with viewer(str(tmp_path)) as page:
        tab.goto(page.url)
        for kind in ("log", "reason", "name", "note", "pair"):
            tab.get_by_text(f"{kind} {spoken}").first.wait_for()
        tab.keyboard.press("End")
        wait_for(lambda: time_shown(tab) == round(float(recording.times[-1]), 3))
        assert tab.locator("iframe, img[src=x], a, strong:text('bold')").count() == 0
        assert tab.evaluate("window.owned") is None
        page.process.terminate()
        assert page.process.wait(60) == 0


def test_the_page_explains_the_input_at_the_time_shown_and_no_longer_once_it_is_closed(
    tab: "Tab", finished: Path
) -> None:
    replay = open_replay(finished)
    with served(replay) as page:
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.get_by_text("5 agents (2 adversaries)").wait_for()
        replay.seek(2.0)
        wait_for(lambda: time_shown(tab) == pytest.approx(2.0, abs=0.01))
        tab.get_by_text("Explanation", exact=True).click()
        tab.get_by_role("button", name="Explain the agent's input").click()
        expected = explain(read(finished), "1", replay.t).sentences()[0]
        assert expected.startswith("Agent 1 at t = 1.99")
        tab.get_by_text(expected).wait_for()
        tab.get_by_role("button", name="Explain the agent's input").click()
        tab.get_by_text("Explaining agent").wait_for()
        (visitor,) = page.visitors.values()
        assert visitor.explanation is not None
        program = visitor.explanation.program
        assert program is not None
        program.send_signal(signal.SIGSTOP)  # so that it cannot end by itself before the tab does
        tab.close()
        wait_for(lambda: not page.visitors)
        assert program.wait(60) == -signal.SIGKILL
