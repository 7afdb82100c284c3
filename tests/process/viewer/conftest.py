"""Fixtures of the viewer's tests: a headless browser, and a finished run to replay."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from phalanx.scenario.load import load
from tests.process.runs import live_run

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

_FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


@pytest.fixture(scope="session")
def browser() -> Iterator["Browser"]:
    """Chromium that renders in software."""
    api = pytest.importorskip("playwright.sync_api", reason="needs pip install playwright")
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("needs a chromium on the path")
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=_FLAGS)
        yield started
        started.close()


@pytest.fixture
def tab(browser: "Browser") -> Iterator["Tab"]:
    """A tab that fails the test if the page ever reached out to another host."""
    opened = browser.new_page(viewport={"width": 1400, "height": 900})
    opened.set_default_timeout(120_000)  # it draws in software, on whatever cores are left
    foreign: list[str] = []
    opened.on("request", lambda r: None if "//127.0.0.1" in r.url else foreign.append(r.url))
    yield opened
    opened.close()
    assert [url for url in foreign if url.startswith("http")] == []


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of Simulation 1's first seconds, with some loss and delay."""
    overrides = ["duration=4.0", "network.loss=0.2", "network.delay=0.005"]
    folder = tmp_path_factory.mktemp("finished") / "run"
    with live_run(load("unicycles", overrides), folder) as run:
        run.summary()
    return folder
