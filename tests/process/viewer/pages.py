"""Viewer processes: started as a user would, found by the address they print, never left behind."""

import contextlib
import os
import re
import select
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

import msgspec
import viser
import zstandard
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.page import Page
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from phalanx.messages.frames import Frame
from tests.process.runs import SECRET, free_port, wait_for

if TYPE_CHECKING:
    from playwright.sync_api import Locator
    from playwright.sync_api import Page as Tab

PATIENCE = 120.0
"""Time for a page on busy cores to say something [s]."""


def pixels(canvas: "Locator") -> str:
    """Pixels of a canvas, as a data URL.

    A screenshot waits until the page around it stands still, which a scene that is drawn in
    software may not do for minutes on a busy machine.
    """
    pixels: str = canvas.evaluate("canvas => canvas.toDataURL()")
    return pixels


def labelled(tab: "Tab", label: str) -> "Locator":
    """The first text field of a labelled row."""
    row = tab.locator("label", has_text=label).first.locator(
        "xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]"
    )
    return row.locator("input").first


def set_display(tab: "Tab", *options: str) -> None:
    """Click checkboxes in the folder of display options, which is folded at first."""
    if not tab.get_by_role("checkbox", name="Dark").count():
        tab.get_by_text("Display", exact=True).click()
    for option in options:
        # Not at its place on the page, which moves while the folder opens.
        tab.get_by_role("checkbox", name=option).evaluate("box => box.click()")


class Viewer:
    """One `phalanx view` process."""

    def __init__(
        self, *arguments: str, secret: bytes = SECRET, command_secret: bytes = b""
    ) -> None:
        environment = {
            "PHALANX_SECRET": secret.decode(),
            "PHALANX_COMMAND_SECRET": command_secret.decode(),
        }
        self.process = subprocess.Popen(
            [sys.executable, "-m", "phalanx", "view", "--port", str(free_port()), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **environment},
        )
        self.printed = ""
        """Before it printed its address."""
        self.url = self._printed_url(120.0)

    def _printed_url(self, seconds: float) -> str:
        assert self.process.stdout is not None
        pipe = self.process.stdout.fileno()
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if not select.select([pipe], [], [], 0.5)[0]:
                continue
            # Not readline: select does not see a second line that the file object has buffered.
            read = os.read(pipe, 65536)
            self.printed += read.decode(errors="replace")
            if address := re.search(r"^viewer: (http://\S+)\n", self.printed, re.MULTILINE):
                return address.group(1)
            assert read, self.printed
        raise AssertionError(f"the viewer printed no address: {self.printed}")

    def answers(self) -> bool:
        """True if the page is served."""
        with urllib.request.urlopen(self.url, timeout=60) as page:
            return page.status == 200


def chosen(page: Page) -> int:
    """The agent that a page's only visitor chose; -1 before there is one."""
    return next((visitor.selected for visitor in page.visitors.values()), -1)


@contextlib.contextmanager
def viewer(*arguments: str, command_secret: bytes = b"") -> Iterator[Viewer]:
    """A viewer for the length of a block."""
    started = Viewer(*arguments, command_secret=command_secret)
    try:
        yield started
    finally:
        started.process.kill()
        print(started.process.communicate()[0])  # seen if the test fails


class Watcher:
    """A live viewer without a page."""

    def __init__(self, live: Live) -> None:
        self.live = live
        self.frame: Frame | None = None

    def until(self, holds: Callable[[Frame], bool]) -> Frame:
        """The first frame for which `holds` is true."""

        def newest() -> bool:
            self.frame = self.live.take() or self.frame
            return self.frame is not None and holds(self.frame)

        wait_for(newest)
        assert self.frame is not None
        return self.frame


Numbers = Sequence[float]


def camera_message(position: Numbers, look_at: Numbers, wxyz: Numbers) -> bytes:
    """A browser's report of where its camera is, and where it looks."""
    camera = {
        "type": "ViewerCameraMessage", "wxyz": wxyz, "fov": 1.0,
        "position": position, "look_at": look_at, "up_direction": [0.0, 1.0, 0.0],
        "near": 0.1, "far": 9.0, "image_height": 9, "image_width": 9,
    }  # fmt: skip
    return msgspec.msgpack.encode(camera)


@contextlib.contextmanager
def visitor(
    port: int, position: Numbers = (0.0, 0.0, 0.0), look_at: Numbers = (1.0,) * 3
) -> Iterator[ClientConnection]:
    """A visitor without a browser, who looks from one point of the scene at another."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol]) as connection:
        connection.send(camera_message(position, look_at, (1.0, 0.0, 0.0, 0.0)))
        yield connection


class Client:
    """A visitor without a browser, and all that the page has sent."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.received, self.clicked = "", 0
        self.name = self.until(r'phalanx\.connect\("([^"]+)"\)')
        """The name that the page gave it."""

    def until(self, pattern: str) -> str:
        """Receive until this came since the last click, and return the pattern's group."""
        while not (match := re.search(pattern, self.received[self.clicked :])):
            for message in messages(bytes(self.connection.recv(PATIENCE))):
                self.received += f"{message}\n"
        return match[1]

    def group(self, button: str) -> str:
        """Return the id of the group that has this button."""
        return self.until(f"(?m)^(?=.*'{button}').*'uuid': '([^']+)'")

    def field(self, label: str) -> str:
        """Return the id of the list or checkbox with this label."""
        return self.until(f"(?m)^(?=.*'label': '{label}').*'uuid': '([^']+)'")

    def click(self, uuid: str, value: str | bool) -> None:
        """Click a button of a group, choose from a list, or set a checkbox."""
        self.clicked = len(self.received)
        update = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
        self.connection.send(msgspec.msgpack.encode(update))
        assert self.connection.ping().wait(PATIENCE)


def messages(frame: bytes) -> list[dict[str, object]]:
    """Every message that viser sends a page at once."""
    packed = 16 + int.from_bytes(frame[8:16], "little")
    content = msgspec.msgpack.decode(zstandard.decompress(frame[16:packed]))["messages"]
    return [message for message in content if isinstance(message, dict)]


@contextlib.contextmanager
def served(replay: Replay, port: int | None = None) -> Iterator[Page]:
    """The page of a replay, kept up to date by a thread of the test's own process."""
    page = Page("127.0.0.1", port or free_port(), (), replay)
    over = threading.Event()

    def serve() -> None:
        while not over.wait(0.03):
            page.tick()

    with ThreadPoolExecutor(1, "page") as thread:
        serving = thread.submit(serve)
        try:
            yield page
        finally:
            over.set()
            wait([serving])
            page.server.stop()
            serving.result()  # why a page died, before what a test missed on it
