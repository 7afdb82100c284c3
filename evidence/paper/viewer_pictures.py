"""The pictures of docs/viewer.md: the viewer's page in a headless Chromium, live and in replays.

python evidence/paper/viewer_pictures.py                    # all of them
python evidence/paper/viewer_pictures.py viewer-space live  # those whose names contain one of these
"""

import contextlib
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.scene.server import choose_port
from PIL import Image
from playwright.sync_api import sync_playwright

import phalanx
from phalanx.scenario.load import load

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

IMAGES = Path("docs/images")
HOST = "127.0.0.1"
WIDE, DESK, NARROW = (1440, 900), (1280, 800), (800, 600)
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
CLOCK = r"t = ([\d.]+) s"
# What viser says of a browser without a graphics card would cover the scene.
HIDE_NOTES = ".mantine-Notifications-root { display: none } :root { --phx-notice: 0px !important }"
CROWD = ("agents.0.count=112", "agents.1.count=16", "duration=3.0")


@dataclass(frozen=True)
class Shot:
    """A picture of a recorded run."""

    name: str
    scenario: str
    overrides: tuple[str, ...] = ()
    at: float | None = None
    """[s]; by default the worst moment."""
    size: tuple[int, int] = WIDE
    dark: bool = False


SHOTS = (
    Shot("viewer", "unicycles"),
    Shot("viewer-narrow", "unicycles", size=NARROW),
    Shot("viewer-space", "formation3d"),
    Shot("viewer-space-narrow", "formation3d", size=NARROW),
    Shot("viewer-fence", "fence"),
    Shot("viewer-fence-narrow", "fence", size=NARROW),
    Shot("viewer-alarm", "surrounded", at=1.2),
    Shot("viewer-alarm-narrow", "surrounded", at=1.2, size=NARROW, dark=True),
    Shot("viewer-swarm", "swarm", CROWD, at=2.5),
    Shot("viewer-radio", "radio", at=2.6, size=DESK),
    Shot("viewer-radio-dark", "radio", at=2.6, size=DESK, dark=True),
)
LIVE = {"viewer-live": WIDE, "viewer-live-narrow": NARROW}
"""Pictures of a live run."""


def main() -> None:
    """Make all of them."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        runs: dict[tuple[str, tuple[str, ...]], phalanx.Run] = {}
        for shot in filter(lambda shot: is_wanted(shot.name), SHOTS):
            key = shot.scenario, shot.overrides
            if key not in runs:
                scenario = load(shot.scenario, list(shot.overrides))
                runs[key] = phalanx.run(scenario, engine="in-process")
            take(browser, shot, runs[key].folder)
        for name, size in LIVE.items():
            if is_wanted(name):
                take_live(browser, name, size)
        browser.close()


def is_wanted(name: str) -> bool:
    """Return whether the command line asks for a picture."""
    return not sys.argv[1:] or any(part in name for part in sys.argv[1:])


def take(browser: "Browser", shot: Shot, folder: Path) -> None:
    """Take a picture of a replay."""
    replay = open_replay(folder)
    t = replay.frame(replay.worst_at if shot.at is None else shot.at).t
    port = choose_port(HOST, None)
    viewer = subprocess.Popen(
        [sys.executable, "-m", "phalanx", "view", str(folder), "--port", str(port)]
    )
    try:
        with opened(browser, port, shot.size) as tab:
            if shot.dark:
                tab.get_by_text("Display", exact=True).click()
                tab.get_by_role("checkbox", name="Dark").evaluate("box => box.click()")
                tab.get_by_text("Display", exact=True).click()
            while not tab.get_by_text(f"t = {t:.3f} s").count():
                tab.evaluate(f"window.phalanx.act({{seek: {t + 1e-6}}})")
                tab.wait_for_timeout(500)
            save(settled(tab), shot.name)
    finally:
        viewer.terminate()
        viewer.wait()


def take_live(browser: "Browser", name: str, size: tuple[int, int]) -> None:
    """Take a picture of a run that goes on, a few seconds after its start."""
    port = choose_port(HOST, None)
    with tempfile.TemporaryDirectory() as out:
        # In real time a browser without a graphics card would lag behind.
        pace = ["--view", "--speed", "0.1", "--port", str(port)]
        command = ["run", "unicycles", *pace, "--out", out]
        run = subprocess.Popen([sys.executable, "-m", "phalanx", *command])
        try:
            with opened(browser, port, size) as tab:
                clock = f"(document.body.innerText.match(/{CLOCK}/) || [0, 0])[1]"
                tab.wait_for_function(f"+{clock} > 2.5")
                save(screenshot(tab), name)
        finally:
            stop(run)


def stop(run: subprocess.Popen[bytes]) -> None:
    """End a live run, then the replay that its page goes on with."""
    while run.poll() is None:
        run.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.wait(timeout=10.0)


@contextlib.contextmanager
def opened(browser: "Browser", port: int, size: tuple[int, int]) -> Iterator["Tab"]:
    """A tab with the page; it draws in software and may be slow."""
    tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
    tab.set_default_timeout(180_000)
    for _ in range(100):
        with contextlib.suppress(Exception):  # a live run's page is not there at once
            # Else viser draws coarser while the browser is slow, and again finer.
            tab.goto(f"http://{HOST}:{port}/?fixedDpr=1")
            break
        tab.wait_for_timeout(300)
    tab.add_style_tag(content=HIDE_NOTES)
    tab.get_by_text("Legend").wait_for(state="attached")
    try:
        yield tab
    finally:
        tab.close()


def settled(tab: "Tab") -> Image.Image:
    """The page once it has not changed for a while: the scene comes in steps."""
    last, same = [screenshot(tab)], 0
    while same < 4:
        tab.wait_for_timeout(1000)
        now = screenshot(tab)
        # The field of view is nudged to and fro once a second: between two pictures.
        same = same + 1 if now in last else 0
        last = [last[-1], now]
    return last[-1]


def screenshot(tab: "Tab") -> Image.Image:
    """The page as it is."""
    return Image.open(BytesIO(tab.screenshot())).convert("RGB")


def save(image: Image.Image, name: str) -> None:
    """Save a picture."""
    image.save(IMAGES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
